"""One step and the roll-out against the equations written out, for every `Follow`."""

import math
from dataclasses import replace

import numpy as np
import pytest
from made_models import input_matrix

from rt_controller.contract.arrays import Array
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import (
    NO_SIGNAL,
    Bilinear,
    Drift,
    Follow,
    Matrices,
    one_step,
    roll_out,
)


def drift_of(bundle: Bundle, psi: Array, w: Array) -> Array:
    """Sum over r of N_r (tanh(a) - a), or of N_r tanh(a) w, with a = S_r psi + s0_r."""
    total = np.zeros(bundle.n_observables)
    if bundle.drift is None:
        return total
    N, S, s0, signal = bundle.drift
    for r in range(len(s0)):
        a = float(S[r] @ psi + s0[r])
        term = math.tanh(a) - a if signal[r] == NO_SIGNAL else math.tanh(a) * w[signal[r]]
        total += N[:, r] * term
    return total


@pytest.mark.parametrize("follow", Follow)
@pytest.mark.parametrize("has_drift", [False, True])
@pytest.mark.parametrize("saturates", [False, True])
def test_a_roll_out_is_the_recursion_written_out(
    bundle: Bundle, saturates: bool, has_drift: bool, follow: Follow
) -> None:
    assert bundle.bilinear is not None
    bilinear = bundle.bilinear._replace(follows=follow, saturates=saturates)
    bundle = replace(bundle, bilinear=bilinear, drift=bundle.drift if has_drift else None)
    rng = np.random.default_rng(1)
    psi0, U, W = rng.normal(size=(2, 9)), rng.normal(size=(2, 5, 3)), rng.normal(size=(2, 5, 1))
    found = roll_out(bundle, psi0, U, W, outputs=6)
    for b in range(2):
        psi = free = psi0[b]
        for k in range(5):
            seen = {Follow.PREDICTION: psi, Follow.FREE_RESPONSE: free, Follow.START: psi0[b]}
            followed = seen[follow]
            undriven = bundle.B_uw @ W[b, k] + bundle.c
            driven = input_matrix(bundle, followed) @ U[b, k] + drift_of(bundle, followed, W[b, k])
            psi = bundle.A @ psi + driven + undriven
            free = bundle.A @ free + undriven
            np.testing.assert_allclose(found[b, k + 1], psi[:6], rtol=1e-10)
    np.testing.assert_array_equal(found[:, 0], psi0[:, :6])


def test_without_a_bilinear_part_the_drift_follows_the_prediction(bundle: Bundle) -> None:
    alone = replace(bundle, bilinear=None)
    rng = np.random.default_rng(3)
    psi0, U, W = rng.normal(size=(1, 9)), rng.normal(size=(1, 4, 3)), rng.normal(size=(1, 4, 1))
    psi = psi0[0]
    for k in range(4):
        undriven = bundle.B_uw @ W[0, k] + bundle.c + drift_of(bundle, psi, W[0, k])
        psi = bundle.A @ psi + bundle.B_uc @ U[0, k] + undriven
    np.testing.assert_allclose(roll_out(alone, psi0, U, W, outputs=9)[0, -1], psi, rtol=1e-10)


def test_one_step_takes_a_single_state_or_a_batch(bundle: Bundle) -> None:
    rng = np.random.default_rng(2)
    psi, u, w = rng.normal(size=(4, 9)), rng.normal(size=(4, 3)), rng.normal(size=(4, 1))
    batch = one_step(bundle, psi, u, w)
    single = one_step(bundle, psi[2], u[2], w[2])
    np.testing.assert_allclose(single, batch[2], rtol=1e-12)


def test_without_a_bilinear_part_and_a_drift_the_model_is_linear(planar: Bundle) -> None:
    psi, u, w = np.ones(5), np.full(len(planar.B_uc[0]), 2.0), np.zeros(len(planar.B_uw[0]))
    expected = planar.A @ psi + planar.B_uc @ u + planar.c
    np.testing.assert_allclose(one_step(planar, psi, u, w), expected, rtol=1e-12)


def test_with_saturating_gains_a_long_roll_out_at_ten_times_the_inputs_is_bounded() -> None:
    """2,000 steps; A contracts every lifted state to 0.95 of its size."""
    rng = np.random.default_rng(4)
    n, m, rank, instants = 6, 2, 3, 2000
    A, _ = np.linalg.qr(rng.normal(size=(n, n)))
    bilinear = Bilinear(
        rng.normal(size=(rank, n, m)), rng.normal(size=(rank, m, n)), rng.normal(size=(rank, m))
    )
    drift = Drift(
        0.1 * rng.normal(size=(n, 2)),
        rng.normal(size=(2, n)),
        np.zeros(2),
        np.array([0, 0], dtype=np.int64),
    )
    model = Matrices(
        0.95 * A, rng.normal(size=(n, m)), np.zeros((n, 1)), np.zeros(n), bilinear, drift
    )
    U, W = 10.0 * rng.uniform(-1.0, 1.0, size=(4, instants, m)), np.ones((4, instants, 1))
    psi0 = rng.normal(size=(4, n))
    saturating = model._replace(bilinear=bilinear._replace(saturates=True))
    found = roll_out(saturating, psi0, U, W, outputs=n)
    columns = np.abs(bilinear.N).sum(axis=0) + np.abs(model.B_uc)
    per_step = np.linalg.norm(10.0 * columns.sum(axis=1) + np.abs(drift.N).sum(axis=1))
    assert np.linalg.norm(found, axis=-1).max() <= per_step / 0.05
    with np.errstate(all="ignore"):
        assert not np.isfinite(roll_out(model, psi0, U, W, outputs=n)).all()
