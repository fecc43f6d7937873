"""The effect of the inputs at a lifted state against the formula of the bilinear model."""

import math
from dataclasses import replace

import numpy as np
import pytest
from made_models import input_matrix

from rt_controller.contract.arrays import Array
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import one_step


def effect_of(bundle: Bundle, u: Array, psi: Array) -> Array:
    """What the inputs u add to the next lifted state."""
    w = np.zeros((*psi.shape[:-1], bundle.B_uw.shape[1]))
    return one_step(bundle, psi, u, w) - one_step(bundle, psi, 0.0 * u, w)


@pytest.mark.parametrize("saturates", [False, True])
def test_the_effect_equals_the_sum_in_the_formula(bundle: Bundle, saturates: bool) -> None:
    assert bundle.bilinear is not None
    bundle = replace(bundle, bilinear=bundle.bilinear._replace(saturates=saturates))
    assert bundle.bilinear is not None
    N, S, s0 = bundle.bilinear[:3]
    rng = np.random.default_rng(3)
    psi_0, u = rng.normal(size=9), rng.normal(size=3)
    B_eff = bundle.B_uc.copy()
    for i in range(3):
        for r in range(2):
            share = S[r, i] @ psi_0 + s0[r, i]
            B_eff[:, i] += N[r, :, i] * (math.tanh(share) if saturates else share)
    np.testing.assert_allclose(effect_of(bundle, u, psi_0), B_eff @ u, rtol=1e-9)
    np.testing.assert_allclose(input_matrix(bundle, psi_0), B_eff, rtol=1e-12)


def test_it_equals_the_bilinear_model_at_psi_0(bundle: Bundle) -> None:
    """sum_i u_i (b_i + N_i psi_0) with the matrices N_i = sum_r N[r, :, i] S[r, i]', if s0 = 0."""
    assert bundle.bilinear is not None
    bilinear = bundle.bilinear._replace(s0=np.zeros((2, 3)), saturates=False)
    rng = np.random.default_rng(4)
    psi_0, u = rng.normal(size=9), rng.normal(size=3)
    matrices = [bilinear.N[:, :, i].T @ bilinear.S[:, i] for i in range(3)]
    assert {np.linalg.matrix_rank(matrix) for matrix in matrices} == {2}
    expected = sum(u[i] * (bundle.B_uc[:, i] + matrices[i] @ psi_0) for i in range(3))
    found = effect_of(replace(bundle, bilinear=bilinear), u, psi_0)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_saturating_gains_are_at_most_one(bundle: Bundle) -> None:
    assert bundle.bilinear is not None
    psi, u = 1e6 * np.random.default_rng(7).normal(size=9), np.eye(3)[1]
    largest = np.abs(bundle.B_uc[:, 1]) + np.abs(bundle.bilinear.N[:, :, 1]).sum(axis=0)
    assert np.all(np.abs(effect_of(bundle, u, psi)) <= largest + 1e-6)


def test_each_lifted_state_of_a_batch_has_its_own_effect(bundle: Bundle) -> None:
    rng = np.random.default_rng(5)
    psi, u = rng.normal(size=(4, 2, 9)), rng.normal(size=(4, 2, 3))
    effects = effect_of(bundle, u, psi)
    assert effects.shape == psi.shape
    np.testing.assert_allclose(effects[3, 1], effect_of(bundle, u[3, 1], psi[3, 1]), rtol=1e-9)


def test_without_a_bilinear_part_the_effect_is_that_of_b_uc(planar: Bundle) -> None:
    u = np.random.default_rng(6).normal(size=(7, 2))
    effects = effect_of(planar, u, np.ones((7, 5)))
    np.testing.assert_allclose(effects, u @ planar.B_uc.T, rtol=1e-9)
