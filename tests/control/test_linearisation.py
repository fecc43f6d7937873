"""The derivatives along a plan are those of the model's own roll-out, for every class of model."""

from itertools import product

import numpy as np
import pytest
from made_models import WITH_ALL
from model_classes import RANGE, VARIANTS, knots_of, made

from rt_controller.contract.signals import N_STATES
from rt_controller.control.linearisation import ALL_INPUTS, Linearisation
from rt_controller.control.terms import place_knots
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.dynamics import roll_out
from rt_controller.model.follow import Follow

HORIZON, CURVATURE_PER_M = 20, 0.002
CASES = [
    (variant, follows)
    for variant in VARIANTS
    for follows in (Follow if "rank" in VARIANTS[variant] else [Follow.PREDICTION])
]
SHIPPED = ("lti", "mdk-net", "mdk-net-paper")


def rolled(bundle, psi, curvature_per_m, inputs):
    """States of stages 1 … N, (N, 6)."""
    W = np.full((1, len(inputs), 1), curvature_per_m)
    return roll_out(bundle, psi[None], inputs[None], W, N_STATES)[0, 1:]


def assert_derivatives(bundle, psi, count, used=ALL_INPUTS):
    """By the used inputs at each knot, the curvature and psi_0, to 1e-6 of the largest."""
    knots, plan = place_knots(HORIZON, count), knots_of(count)
    found = Linearisation(bundle, knots, list(range(N_STATES)))
    inputs = knots.interpolation @ plan
    found.update(psi, CURVATURE_PER_M, inputs, used)

    def at_ends(change, curvature_per_m=CURVATURE_PER_M, start=psi):
        stages = np.array(knots.ends) - 1
        moved = knots.interpolation @ (plan + change)
        return rolled(bundle, start, curvature_per_m, moved)[stages]

    expected = np.zeros((count, N_STATES, 3, count))
    for knot, column in product(range(count), range(3)[used]):
        step = np.zeros(plan.shape)
        step[knot, column] = 1e-4 * RANGE[column]
        expected[..., column, knot] = (at_ends(step) - at_ends(-step)) / 2e-4
    assert_near(found.by_inputs[:, :, used] * RANGE[used, None], expected[:, :, used])
    if bundle.gains is not None and bundle.gains.follows is not Follow.PREDICTION:
        return
    none = np.zeros(plan.shape)
    by_curvature = at_ends(none, CURVATURE_PER_M + 1e-6) - at_ends(none, CURVATURE_PER_M - 1e-6)
    assert_near(found.by_curvature, by_curvature / 2e-6)
    for step in 1e-4 * bundle.spread * np.random.default_rng(0).normal(size=(3, len(psi))):
        ends = at_ends(none, start=psi + step) - at_ends(none, start=psi - step)
        assert_near(found.by_psi @ step, 0.5 * ends)


def assert_near(found, expected):
    """To 1e-6 of the largest value of each state."""
    others = (0, *range(2, expected.ndim))
    error, largest = (np.abs(each).max(axis=others) for each in (found - expected, expected))
    assert np.all(error <= 1e-6 * largest)


@pytest.mark.parametrize(
    ("knots", "used"), [(7, ALL_INPUTS), (10, slice(0, 3, 2)), (HORIZON, slice(1, 3))]
)
@pytest.mark.parametrize(("variant", "follows"), CASES)
def test_derivatives_are_finite_differences_of_the_roll_out(variant, follows, knots, used):
    bundle = made(variant, follows)
    if variant == "linear":
        used = ALL_INPUTS  # its derivatives are constant
    for psi in bundle.selftest_psi[:2]:
        assert_derivatives(bundle, psi, knots, used)


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_same_with_a_history(variant):
    bundle = made(variant, lift=WITH_ALL)
    assert_derivatives(bundle, bundle.selftest_psi[0], count=7)


@pytest.mark.parametrize("model", SHIPPED)
def test_the_same_of_the_shipped_models(model):
    bundle = load_bundle(shipped_model(model))
    for psi in bundle.selftest_psi[:4]:
        assert_derivatives(bundle, psi, count=10)


@pytest.mark.parametrize(("variant", "follows"), CASES)
def test_the_nominal_prediction_is_the_roll_out(variant, follows):
    bundle, inputs = made(variant, follows), knots_of(HORIZON)
    psi = bundle.selftest_psi[0]
    found = Linearisation(bundle, place_knots(HORIZON, HORIZON), [0])
    found.update(psi, CURVATURE_PER_M, inputs)
    expected = rolled(bundle, psi, CURVATURE_PER_M, inputs)
    np.testing.assert_allclose(found.observables[1:, :N_STATES], expected, rtol=1e-10, atol=1e-10)
