"""One step and the roll-out against the equations written out gain by gain."""

import math
from dataclasses import replace

import numpy as np
import pytest
from made_models import one_step

from rt_controller.contract.arrays import Array
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import Gains, Matrices, Shape, no_gains, roll_out
from rt_controller.model.follow import Follow


def written_out(bundle: Bundle, psi: Array, followed: Array, u: Array, w: Array) -> Array:
    """A psi + B_uc u + B_uw w + c + sum_r N_r g_r(S_r psi' + s0_r) f_r, psi' = `followed` (n,)."""
    following = bundle.A @ psi + bundle.B_uc @ u + bundle.B_uw @ w + bundle.c
    N, S, s0, factor, shape, _ = bundle.gains or no_gains(len(psi))
    signals = [*u, *w, 1.0]
    for r in range(len(s0)):
        a = float(S[r] @ followed + s0[r])
        t = (a, math.tanh(a), math.tanh(a) - a)[shape[r]]
        following = following + N[:, r] * t * signals[factor[r]]
    return following


@pytest.mark.parametrize("shapes", [(), (0,), (1,), (2,), (0, 1, 2)])
@pytest.mark.parametrize("follow", Follow)
def test_a_roll_out_is_the_recursion_written_out(bundle, shapes, follow):
    assert bundle.gains is not None
    N, S, s0, factor, shape, _ = bundle.gains
    kept = np.isin(shape, shapes)
    gains = Gains(N[:, kept], S[kept], s0[kept], factor[kept], shape[kept], follow)
    bundle = replace(bundle, gains=gains if kept.any() else None)
    rng = np.random.default_rng(1)
    psi0, U, W = rng.normal(size=(2, 9)), rng.normal(size=(2, 5, 3)), rng.normal(size=(2, 5, 1))
    found = roll_out(bundle, psi0, U, W, outputs=6)
    np.testing.assert_array_equal(found[:, 0], psi0[:, :6])
    for b in range(2):
        psi = free = psi0[b]
        for k in range(5):
            seen = {Follow.PREDICTION: psi, Follow.FREE_RESPONSE: free, Follow.START: psi0[b]}
            psi = written_out(bundle, psi, seen[follow], U[b, k], W[b, k])
            free = bundle.A @ free + bundle.B_uw @ W[b, k] + bundle.c
            np.testing.assert_allclose(found[b, k + 1], psi[:6], rtol=1e-9)


def test_one_step_takes_a_single_state_or_a_batch(bundle, planar):
    rng = np.random.default_rng(2)
    for model in (bundle, planar):
        (n, m), p = model.B_uc.shape, model.B_uw.shape[1]
        psi, u, w = (rng.normal(size=(4, 2, size)) for size in (n, m, p))
        batch = one_step(model, psi, u, w)
        assert batch.shape == psi.shape
        expected = written_out(model, psi[3, 1], psi[3, 1], u[3, 1], w[3, 1])
        np.testing.assert_allclose(batch[3, 1], expected, rtol=1e-9)
        np.testing.assert_allclose(one_step(model, psi[3, 1], u[3, 1], w[3, 1]), batch[3, 1])


def test_it_equals_the_bilinear_model_of_the_literature(bundle):
    """sum_i u_i (b_i + N_i psi_0) with the matrices N_i = sum_r N_r S_r', if s0 = 0."""
    assert bundle.gains is not None
    N, S, factor = bundle.gains.N[:, :6], bundle.gains.S[:6], bundle.gains.factor[:6]
    gains = Gains(N, S, np.zeros(6), factor, np.full(6, Shape.LINEAR))
    rng = np.random.default_rng(4)
    psi, u, w = rng.normal(size=9), rng.normal(size=3), np.zeros(1)
    matrices = [N[:, factor == i] @ S[factor == i] for i in range(3)]
    assert {np.linalg.matrix_rank(matrix) for matrix in matrices} == {2}
    expected = sum(u[i] * (bundle.B_uc[:, i] + matrices[i] @ psi) for i in range(3))
    model = replace(bundle, gains=gains)
    found = one_step(model, psi, u, w) - one_step(model, psi, 0.0 * u, w)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_saturation_is_zero_with_its_slope_at_zero_and_linear_far_from_it():
    """So A describes a small motion, and A minus N S a large one."""
    one, zero = np.ones((1, 1)), np.zeros((1, 1))
    gains = Gains(one, one, np.zeros(1), np.array([0]), np.array([Shape.SATURATION]))
    model = Matrices(zero, zero[:, :0], zero[:, :0], np.zeros(1), gains)
    at = [one_step(model, np.array([a]), np.zeros(0), np.zeros(0))[0] for a in (0, 1e-3, 50, -50)]
    assert at[0] == 0.0
    assert abs(at[1]) < 1e-9
    assert at[2:] == pytest.approx([-49.0, 49.0])


def test_with_saturating_gains_a_long_roll_out_at_ten_times_the_inputs_is_bounded():
    """2,000 steps; A contracts every lifted state to 0.95 of its size."""
    rng = np.random.default_rng(4)
    n, m, q, instants = 6, 2, 8, 2000
    A, _ = np.linalg.qr(rng.normal(size=(n, n)))
    N, S, s0 = rng.normal(size=(n, q)), rng.normal(size=(q, n)), rng.normal(size=q)
    gains = Gains(N, S, s0, np.arange(q) % (m + 1), np.full(q, Shape.TANH))
    model = Matrices(0.95 * A, rng.normal(size=(n, m)), np.zeros((n, 1)), np.zeros(n), gains)
    U, W = 10.0 * rng.uniform(-1.0, 1.0, size=(4, instants, m)), np.ones((4, instants, 1))
    psi0 = rng.normal(size=(4, n))
    found = roll_out(model, psi0, U, W, outputs=n)
    per_step = np.linalg.norm(10.0 * (np.abs(model.B_uc).sum(axis=1) + np.abs(N).sum(axis=1)))
    assert np.linalg.norm(found, axis=-1).max() <= per_step / 0.05
    linear = model._replace(gains=gains._replace(shape=np.full(q, Shape.LINEAR)))
    with np.errstate(all="ignore"):
        assert not np.isfinite(roll_out(linear, psi0, U, W, outputs=n)).all()
