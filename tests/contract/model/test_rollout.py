"""One step and the roll-out against the equations written out, for every `Follow`."""

from dataclasses import replace

import numpy as np
import pytest
from made_models import input_matrix

from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.model.follow import Follow
from rt_controller.contract.model.rollout import one_step, roll_out


@pytest.mark.parametrize("follow", Follow)
def test_rollout_of_a_bilinear_model_is_the_recursion_written_out(
    bundle: Bundle, follow: Follow
) -> None:
    assert bundle.bilinear is not None
    bundle = replace(bundle, bilinear=bundle.bilinear._replace(follows=follow))
    rng = np.random.default_rng(1)
    psi0, U, W = rng.normal(size=(2, 9)), rng.normal(size=(2, 5, 3)), rng.normal(size=(2, 5, 1))
    found = roll_out(bundle, psi0, U, W, outputs=6)
    for b in range(2):
        psi = free = psi0[b]
        for k in range(5):
            seen = {Follow.PREDICTION: psi, Follow.FREE_RESPONSE: free, Follow.START: psi0[b]}
            undriven = bundle.B_uw @ W[b, k] + bundle.c
            psi = bundle.A @ psi + input_matrix(bundle, seen[follow]) @ U[b, k] + undriven
            free = bundle.A @ free + undriven
            np.testing.assert_allclose(found[b, k + 1], psi[:6], rtol=1e-10)
    np.testing.assert_array_equal(found[:, 0], psi0[:, :6])


def test_one_step_takes_a_single_state_or_a_batch(bundle: Bundle) -> None:
    rng = np.random.default_rng(2)
    psi, u, w = rng.normal(size=(4, 9)), rng.normal(size=(4, 3)), rng.normal(size=(4, 1))
    batch = one_step(bundle, psi, psi, u, w)
    single = one_step(bundle, psi[2], psi[2], u[2], w[2])
    np.testing.assert_allclose(single, batch[2], rtol=1e-12)


def test_without_a_bilinear_part_the_model_is_linear(planar: Bundle) -> None:
    psi, u, w = np.ones(5), np.full(len(planar.B_uc[0]), 2.0), np.zeros(len(planar.B_uw[0]))
    expected = planar.A @ psi + planar.B_uc @ u + planar.c
    np.testing.assert_allclose(one_step(planar, psi, psi, u, w), expected, rtol=1e-12)
