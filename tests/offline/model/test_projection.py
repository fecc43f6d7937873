"""Projection moves eigenvalues above the bound to it and changes nothing else."""

import numpy as np
import pytest
import scipy.linalg
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from offline.config import PRESETS
from offline.data.signals import VEHICLE_ROLES
from offline.model.network import MdkNet, sizes_of
from offline.model.projection import project, with_bounded_spectrum
from rt_controller.contract.schema import VEHICLE

Array = NDArray[np.float64]

CHAIN = np.array([[1.0, 0.8, 0.0], [0.0, 1.0, 0.02], [0.0, 0.0, 1.0]])
"""lateral error, heading error, yaw rate at 30 m/s: a Jordan block at 1"""

seeds = st.integers(0, 2**31)
seeded = settings(derandomize=True, deadline=None)


def radius(A: Array) -> float:
    return float(np.abs(np.linalg.eigvals(A)).max())


def of_spectrum(eigenvalues: list[complex], seed: int) -> Array:
    """A real matrix (n, n) of these eigenvalues, in well-conditioned random directions.

    One of a complex pair stands for both.
    """
    blocks = [
        np.array([[v.real, v.imag], [-v.imag, v.real]]) if isinstance(v, complex) else [[v]]
        for v in eigenvalues
    ]
    T = scipy.linalg.block_diag(*blocks)
    rng = np.random.default_rng(seed)
    directions = np.eye(len(T)) + 0.1 * rng.normal(size=T.shape)
    return directions @ T @ np.linalg.inv(directions)


def spectrum(A: Array) -> Array:
    return np.sort_complex(np.linalg.eigvals(A))


@seeded
@given(seeds)
def test_eigenvalues_above_the_bound_are_moved_to_it_and_the_others_are_kept(seed):
    A = of_spectrum([1.3, 0.95, -1.1, 0.2, -0.7], seed)
    found = spectrum(with_bounded_spectrum(A))
    np.testing.assert_allclose(found, spectrum(of_spectrum([1.0, 0.95, -1.0, 0.2, -0.7], seed)))


@seeded
@given(seeds)
def test_a_complex_pair_keeps_its_angle_and_gets_magnitude_one(seed):
    A = of_spectrum([1.05 * np.exp(0.3j), 0.9 * np.exp(1.2j), 0.5], seed)
    expected = of_spectrum([1.0 * np.exp(0.3j), 0.9 * np.exp(1.2j), 0.5], seed)
    np.testing.assert_allclose(spectrum(with_bounded_spectrum(A)), spectrum(expected), atol=1e-9)


@seeded
@given(hnp.arrays(np.float64, (6, 6), elements=st.floats(-2.0, 2.0, width=32)))
def test_every_matrix_has_spectral_radius_at_most_one_afterwards(A):
    """Rounding changes six coinciding eigenvalues by the sixth root of 1e-16."""
    assert radius(with_bounded_spectrum(A)) <= 1.0 + 1e-2


@seeded
@given(seeds)
def test_the_change_of_a_matrix_is_limited_by_the_excess_of_its_radius(seed):
    A = 1.4 * np.random.default_rng(seed).normal(size=(7, 7)) / np.sqrt(7)
    excess = max(0.0, 1.0 - 1.0 / radius(A))
    change = np.linalg.norm(with_bounded_spectrum(A) - A)
    assert change <= excess * np.linalg.norm(A) + 1e-12


def test_a_real_eigenvalue_of_a_non_normal_matrix_is_moved_alone():
    A = np.array([[0.9, 50.0, 3.0], [0.0, 1.001, 40.0], [0.0, 0.0, 0.8]])
    moved = with_bounded_spectrum(A)
    np.testing.assert_allclose(np.linalg.norm(moved - A), 0.001, rtol=1e-6)


@seeded
@given(seeds)
def test_a_stable_matrix_is_not_changed(seed):
    A = of_spectrum([0.999, 0.9 * np.exp(0.4j), -0.3], seed)
    assert with_bounded_spectrum(A) is A


def test_the_chain_from_yaw_rate_to_lateral_error_is_not_changed():
    """A bound on the norm would exclude it."""
    assert np.linalg.norm(CHAIN, 2) > 1.3
    assert np.array_equal(with_bounded_spectrum(CHAIN), CHAIN)


def test_the_chain_is_kept_if_another_eigenvalue_is_moved():
    A = scipy.linalg.block_diag(CHAIN, [[1.2]])
    np.testing.assert_allclose(
        with_bounded_spectrum(A), scipy.linalg.block_diag(CHAIN, [[1.0]]), atol=1e-12
    )


@seeded
@given(seeds)
def test_the_chain_in_other_coordinates_changes_only_by_rounding(seed):
    """Rounding changes three coinciding eigenvalues by the cube root of 1e-16."""
    Q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    turned = Q @ CHAIN @ Q.T
    np.testing.assert_allclose(with_bounded_spectrum(turned), turned, atol=1e-4)


def test_other_bounds_are_respected():
    A = of_spectrum([1.2, 0.9, 0.3], seed=0)
    np.testing.assert_allclose(spectrum(with_bounded_spectrum(A, 0.5)), [0.3, 0.5, 0.5], atol=1e-6)


def test_the_given_matrix_is_not_modified():
    A = of_spectrum([1.2, 0.9, 0.3], seed=0)
    before = A.copy()
    with_bounded_spectrum(A)
    assert np.array_equal(A, before)


def a_model(eigenvalues: list[complex], **changes: object) -> MdkNet:
    """A model whose A, without row and column of the constant, has these eigenvalues."""
    torch.manual_seed(0)
    small = {"hidden": (8, 8), "latents": 5, **changes}
    model = MdkNet(
        PRESETS["recommended"].model_copy(update=small), sizes_of(VEHICLE, VEHICLE_ROLES)
    )
    rows = len(model.A_rows)
    with torch.no_grad():
        model.A_rows[:, :rows] = torch.from_numpy(of_spectrum(eigenvalues, seed=4))
        model.A_rows[:, rows:] = 0.01 * torch.randn(rows, model.n_observables - rows)
    return model


FADING = [0.6, 0.7, 0.8 * np.exp(0.5j), 0.9 * np.exp(0.1j)]
GROWING = [1.01, 1.02 * np.exp(0.2j), *FADING]


def operator_of(model: MdkNet) -> Array:
    return model.operator().A.detach().double().numpy()


@pytest.mark.parametrize(
    ("constant", "eigenvalues"), [(True, [0.95, *GROWING]), (False, [0.95, 0.98, *GROWING])]
)
def test_a_projected_model_has_spectral_radius_one(constant, eigenvalues):
    model = a_model(eigenvalues, constant_observable=constant)
    assert radius(operator_of(model)) > 1.01
    project(model)
    assert radius(operator_of(model)) <= 1.0 + 1e-5


def test_coinciding_eigenvalues_stay_at_the_bound_within_single_precision():
    """At 1 they may be defective; rounding by 6e-8 changes them by its square root."""
    torch.manual_seed(0)
    model = a_model([1.05, 1.1, 1.2, *FADING, 0.5])
    rows = len(model.A_rows)
    with torch.no_grad():
        model.A_rows[:, :rows] += torch.triu(torch.full((rows, rows), 0.1), 1)
    assert radius(operator_of(model)) > 1.1
    project(model)
    assert radius(operator_of(model)) <= 1.0 + 1e-2


def test_projection_keeps_row_and_column_of_the_constant():
    model = a_model([0.95, *GROWING])
    before = operator_of(model)
    project(model)
    after = operator_of(model)
    assert np.array_equal(after[:, -1], before[:, -1])
    assert after[-1].tolist() == [0.0] * 10 + [1.0]
    assert not np.array_equal(after[:-1, :-1], before[:-1, :-1])


def test_projecting_twice_equals_projecting_once():
    model = a_model([0.95, *GROWING])
    project(model)
    once = operator_of(model)
    project(model)
    np.testing.assert_allclose(operator_of(model), once, atol=1e-6)


def test_projection_is_not_part_of_the_gradient():
    model = a_model([0.95, *GROWING])
    others = {n: p.clone() for n, p in model.named_parameters() if n != "A_rows"}
    project(model)
    assert model.A_rows.requires_grad
    assert model.A_rows.grad is None
    assert all(torch.equal(p, others[n]) for n, p in model.named_parameters() if n in others)
