"""The drift: tanh(a) - a, or tanh(a) times an exogenous signal."""

import math

import numpy as np
import pytest

from rt_controller.contract.arrays import Array
from rt_controller.model.dynamics import NO_SIGNAL, Drift, Matrices, no_drift, one_step

N, S, s0 = np.ones((2, 3)), np.array([[1.0, 0.0], [0.0, 2.0], [1.0, 1.0]]), np.array([0.0, 0.5, 1])
MIXED = Drift(N, S, s0, np.array([NO_SIGNAL, 1, 0]))
SATURATION = MIXED._replace(signal=np.full(3, NO_SIGNAL))


def terms_of(drift: Drift, psi: Array, w: Array) -> Array:
    """t (..., D), as the next state of a model with one state for each term and nothing else."""
    (D, n), p = drift.S.shape, w.shape[-1]
    size = max(n, D)
    alone = drift._replace(N=np.eye(size)[:, :D], S=np.pad(drift.S, ((0, 0), (0, size - n))))
    zero = np.zeros((size, size))
    model = Matrices(zero, zero[:, :0], np.zeros((size, p)), zero[0], drift=alone)
    psi = np.concatenate([psi, np.zeros((*psi.shape[:-1], size - n))], axis=-1)
    return one_step(model, psi, w[..., :0], w)[..., :D]


def test_the_terms_are_those_of_the_formula() -> None:
    psi, w = np.array([0.7, -0.2]), np.array([3.0, 5.0])
    a = (0.7, 0.1, 1.5)
    expected = [math.tanh(a[0]) - a[0], math.tanh(a[1]) * 5.0, math.tanh(a[2]) * 3.0]
    np.testing.assert_allclose(terms_of(MIXED, psi, w), expected, rtol=1e-12)
    assert MIXED.is_saturation.tolist() == [True, False, False]
    assert MIXED.rank == 3


def test_each_lifted_state_of_a_batch_has_its_own_terms() -> None:
    rng = np.random.default_rng(0)
    psi, w = rng.normal(size=(4, 5, 2)), rng.normal(size=(4, 5, 2))
    terms = terms_of(MIXED, psi, w)
    assert terms.shape == (4, 5, 3)
    np.testing.assert_allclose(terms[2, 3], terms_of(MIXED, psi[2, 3], w[2, 3]), rtol=1e-12)


def test_a_model_without_exogenous_signals_may_saturate() -> None:
    psi = np.array([[0.7, -0.2], [0.1, 0.3]])
    a = psi @ S.T + s0
    np.testing.assert_allclose(
        terms_of(SATURATION, psi, np.zeros((2, 0))), np.tanh(a) - a, rtol=1e-12
    )
    assert SATURATION.factors(np.zeros((2, 0))).tolist() == [[1.0] * 3] * 2


def test_saturation_is_zero_with_its_slope_at_zero_and_linear_far_from_it() -> None:
    """So A describes a small motion, and A minus N S a large one."""
    one = Drift(np.ones((1, 1)), np.ones((1, 1)), np.zeros(1), np.array([NO_SIGNAL]))
    at = [terms_of(one, np.array([a]), np.zeros(0))[0] for a in (0.0, 1e-3, 50.0, -50.0)]
    assert at[0] == 0.0
    assert abs(at[1]) < 1e-9
    assert at[2:] == pytest.approx([-49.0, 49.0])


def test_no_drift_adds_nothing() -> None:
    none = no_drift(4)
    terms = terms_of(none, np.ones((5, 4)), np.ones((5, 1)))
    assert (none.rank, terms.shape) == (0, (5, 0))
    assert np.array_equal(terms @ none.N.T, np.zeros((5, 4)))
