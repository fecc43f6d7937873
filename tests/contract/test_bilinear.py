"""The input matrix at a lifted state against the formula of the bilinear model."""

from dataclasses import replace

import numpy as np

from rt_controller.contract.bundle import Bundle


def test_the_input_matrix_equals_the_sum_in_the_formula(bundle: Bundle) -> None:
    assert bundle.bilinear is not None
    N, S, s0, _ = bundle.bilinear
    psi_0 = np.random.default_rng(3).normal(size=9)
    expected = bundle.B_uc.copy()
    for i in range(3):
        for r in range(2):
            expected[:, i] += N[r, :, i] * (S[r, i] @ psi_0 + s0[r, i])
    np.testing.assert_allclose(bundle.input_matrix(psi_0), expected, rtol=1e-12)


def test_it_equals_the_bilinear_model_at_psi_0(bundle: Bundle) -> None:
    """sum_i u_i (b_i + N_i psi_0) with the matrices N_i = sum_r N[r, :, i] S[r, i]', if s0 = 0."""
    assert bundle.bilinear is not None
    bilinear = bundle.bilinear._replace(s0=np.zeros((2, 3)))
    rng = np.random.default_rng(4)
    psi_0, u = rng.normal(size=9), rng.normal(size=3)
    matrices = [bilinear.N[:, :, i].T @ bilinear.S[:, i] for i in range(3)]
    assert {np.linalg.matrix_rank(matrix) for matrix in matrices} == {2}
    expected = sum(u[i] * (bundle.B_uc[:, i] + matrices[i] @ psi_0) for i in range(3))
    found = replace(bundle, bilinear=bilinear).input_matrix(psi_0) @ u
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_a_batch_of_lifted_states_has_a_batch_of_input_matrices(bundle: Bundle) -> None:
    psi = np.random.default_rng(5).normal(size=(4, 2, 9))
    matrices = bundle.input_matrix(psi)
    assert matrices.shape == (4, 2, 9, 3)
    np.testing.assert_allclose(matrices[3, 1], bundle.input_matrix(psi[3, 1]), rtol=1e-12)


def test_without_a_bilinear_part_the_input_matrix_is_b_uc(planar: Bundle) -> None:
    matrices = planar.input_matrix(np.ones((7, 5)))
    assert matrices.shape == (7, 5, 2)
    assert np.all(matrices == planar.B_uc)
