"""What a QP is made from: knots, references, pedals, and plans of earlier periods."""

import numpy as np
import pytest

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.limits import PEDAL_CHANGE_S
from rt_controller.contract.signals import (
    CurvaturePreview,
    PathReference,
    VehicleState,
)
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.knots import place_knots
from rt_controller.control.pedals import Pedal, PedalChoice, limit_pedals
from rt_controller.control.reference import ReferenceHorizon


def test_intervals_are_two_periods_first_and_then_four():
    knots = place_knots(40, 14)
    assert knots.intervals.tolist() == [2.0] * 8 + [4.0] * 6
    assert knots.stages == (0, 2, 4, 6, 8, 10, 12, 14, 16, 20, 24, 28, 32, 36)
    assert knots.ends == (*knots.stages[1:], 40)


@pytest.mark.parametrize("count", [None, 12])
def test_without_a_number_there_is_a_knot_at_each_stage(count):
    knots = place_knots(12, count)
    assert knots.stages == tuple(range(12))
    np.testing.assert_array_equal(knots.interpolation, np.eye(12))


@pytest.mark.parametrize("count", [3, 4, 5, 6])
def test_between_the_knots_the_inputs_are_straight_lines_and_constant_behind_the_last(count):
    knots = place_knots(12, count)
    assert knots.count == count
    assert knots.intervals.sum() == 12
    values = np.random.default_rng(count).normal(size=count)
    expected = np.interp(np.arange(12), knots.stages, values)
    np.testing.assert_allclose(knots.interpolation @ values, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("horizon", "count"), [(12, 2), (12, 7), (12, 13), (13, 5), (40, 9)])
def test_other_numbers_are_refused(horizon, count):
    with pytest.raises(ConfigError, match=r"mpc\.knots"):
        place_knots(horizon, count)


KNOTS = place_knots(20, 20)
CRUISING = VehicleState(20.0, 0.0, 0.0, 20.0 * PERIOD_S, 0.0, 0.0)


@pytest.mark.parametrize("seed", range(5))
def test_every_stage_is_the_path_evaluated_at_its_arc_length(seed):
    rng = np.random.default_rng(seed)
    path = PathReference(*rng.normal(size=4) * (1.0, 0.1, 1e-2, 1e-3), 4.0, rng.uniform(-9.0, 3.0))
    state = VehicleState(rng.uniform(5.0, 30.0), 0.1, 0.1, 0.5, 0.1, 0.01)
    curvature_per_m, t = rng.normal() * 0.01, PERIOD_S * np.arange(21)
    v = np.maximum(path.v_mps + path.a_mps2 * t, 0.0)
    lateral = np.polynomial.Polynomial(path[:4])
    s = 0.5 * (state.vx_mps + v) * t
    turned = v * (curvature_per_m + lateral.deriv(2)(s))
    slope = np.arctan(lateral.deriv()(s))
    expected = np.stack([v, 0.0 * v, turned, v * PERIOD_S, lateral(s), slope], axis=1)
    found = ReferenceHorizon(KNOTS).expand(path, state, curvature_per_m)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


PATH = PathReference(0.2, 0.01, 0.001, -2e-4, 21.0, 1.0)
SIGMA_M = 0.5 * (20.0 + 21.0 + PERIOD_S * np.arange(21)) * PERIOD_S * np.arange(21)
"""arc length of the stages on this path"""


def integrated(preview, curvature_per_m):
    """Curvature, slope and lateral place of the road against a circle, by fine sums."""
    s = np.linspace(0.0, SIGMA_M[-1], 200_001)
    knots = preview.spacing_m * np.arange(5)
    bend = np.interp(s, knots, preview[1:]) - curvature_per_m
    slope = np.concatenate([[0.0], np.cumsum(0.5 * (bend[1:] + bend[:-1]) * s[1])])
    lateral = np.concatenate([[0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * s[1])])
    at_stages = [np.interp(SIGMA_M, s, values) for values in (bend, slope, lateral)]
    return at_stages[0], at_stages[1], at_stages[2]


@pytest.mark.parametrize("seed", range(6))
def test_the_road_ahead_is_added_to_the_path(seed):
    """Also of a preview that ends within the horizon, or begins with another curvature."""
    rng = np.random.default_rng(seed)
    preview = CurvaturePreview(rng.uniform(1.0, 6.0), *(rng.normal(size=5) * 0.01).tolist())
    curvature_per_m = preview.k0_per_m if seed % 2 else 0.002
    horizon = ReferenceHorizon(KNOTS)
    plain = horizon.expand(PATH, CRUISING, curvature_per_m).copy()
    found = horizon.expand(PATH, CRUISING, curvature_per_m, preview)
    bend, slope, lateral = integrated(preview, curvature_per_m)
    np.testing.assert_array_equal(found[:, [0, 1, 3]], plain[:, [0, 1, 3]])
    np.testing.assert_allclose(found[:, 2], plain[:, 2] + found[:, 0] * bend, atol=1e-7)
    np.testing.assert_allclose(found[:, 4], plain[:, 4] + lateral, atol=1e-7)
    np.testing.assert_allclose(np.tan(found[:, 5]), np.tan(plain[:, 5]) + slope, atol=1e-7)


@pytest.mark.parametrize("curvature_per_m", [0.0, 0.001, -0.0123])
def test_a_constant_preview_changes_no_bit(curvature_per_m):
    horizon, other = ReferenceHorizon(KNOTS), ReferenceHorizon(KNOTS)
    turning = CurvaturePreview(2.0, 0.0, 0.001, 0.002, 0.003, 0.004)
    horizon.expand(PATH, CRUISING, curvature_per_m, turning)  # leaves nothing behind
    constant = CurvaturePreview(2.0, *[curvature_per_m] * 5)
    expected = other.expand(PATH, CRUISING, curvature_per_m)
    np.testing.assert_array_equal(
        horizon.expand(PATH, CRUISING, curvature_per_m, constant), expected
    )


@pytest.mark.parametrize("curvature_per_m", [0.004, 0.001])
def test_predicted_states_are_counted_from_the_road(curvature_per_m):
    """A car that is predicted on its reference has the errors of the path against the road."""
    preview = CurvaturePreview(2.5, 0.004, 0.003, 0.0, -0.003, -0.001)
    horizon = ReferenceHorizon(KNOTS)
    path = PATH._replace(c1=0.0, c2_per_m=0.0, c3_per_m2=0.0)
    on_path = horizon.expand(path, CRUISING, curvature_per_m, preview)
    found = horizon.counted_from_road(on_path)
    np.testing.assert_allclose(found[:, 4], path.c0_m, atol=1e-12)
    np.testing.assert_allclose(found[:, 5], 0.0, atol=1e-12)
    np.testing.assert_array_equal(found[:, :4], on_path[:, :4])


def test_after_a_delay_the_horizon_begins_so_many_stages_later():
    preview = CurvaturePreview(2.5, 0.004, 0.003, 0.0, -0.003, -0.001)
    later = ReferenceHorizon(KNOTS).expand(PATH, CRUISING, 0.001, preview, delay=3)
    np.testing.assert_allclose(
        later,
        ReferenceHorizon(place_knots(23, 23)).expand(PATH, CRUISING, 0.001, preview)[3:],
        rtol=1e-12,
    )


SLEW = np.array([0.0625, 0.0833, 0.1])
EVERY_PERIOD = np.arange(1, 21)


def ceilings(choice, throttle, brake, periods=EVERY_PERIOD):
    upper = np.ones((len(periods), 3))
    limit_pedals(upper, periods, choice, np.array([throttle, brake, 0.0]), SLEW)
    return upper


@pytest.mark.parametrize(
    ("needed_mps2", "pedal"),
    [
        ([-0.2], Pedal.THROTTLE),
        ([-0.3], Pedal.BRAKE),
        # between its thresholds the choice does not change
        ([-0.3, 0.2], Pedal.BRAKE),
        ([-0.3, 0.3], Pedal.THROTTLE),
        ([-0.3, 0.3, -0.2], Pedal.THROTTLE),
    ],
)
def test_the_pedal_is_that_of_the_acceleration_that_released_pedals_do_not_give(needed_mps2, pedal):
    choice = PedalChoice()
    for each in needed_mps2:
        choice.update(each)
    assert choice.pedal is pedal


@pytest.mark.parametrize(("needed_mps2", "throttle"), [([0.5], 0.2), ([-2.0, 0.5], 0.3)])
def test_the_throttle_in_use_is_not_bounded_and_the_brake_is_not_pressed(needed_mps2, throttle):
    choice = PedalChoice()
    for each in needed_mps2:
        choice.update(each)
    upper = ceilings(choice, throttle=throttle, brake=0.0)
    assert np.all(upper[:, Pedal.THROTTLE] == 1.0)
    assert np.all(upper[:, Pedal.BRAKE] == 0.0)


def test_the_brake_is_released_for_use_after_the_throttle_is_closed():
    choice = PedalChoice()
    choice.update(-2.0)
    upper = ceilings(choice, throttle=0.5, brake=0.0)
    throttle_up = np.flatnonzero(upper[:, Pedal.THROTTLE] == 0.0)[0]
    brake_free = np.flatnonzero(upper[:, Pedal.BRAKE] > 0.0)[0]
    assert throttle_up == 7  # 0.5 / 0.0625 = 8 periods
    assert brake_free == 8
    assert np.all(np.diff(upper[: throttle_up + 1, Pedal.THROTTLE]) >= -SLEW[0] - 1e-12)


def test_with_the_throttle_closed_the_brake_still_waits_for_the_change_of_pedal():
    choice = PedalChoice()
    choice.update(-2.0)
    upper = ceilings(choice, throttle=0.0, brake=0.0)
    ticks = round(PEDAL_CHANGE_S / PERIOD_S)
    assert np.all(upper[:ticks, Pedal.BRAKE] == 0.0)
    assert np.all(upper[ticks:, Pedal.BRAKE] == 1.0)


def test_knots_have_the_bounds_of_their_stages():
    choice = PedalChoice()
    choice.update(-2.0)
    knots = np.array([1, 4, 7, 8, 9, 20])
    every_stage = ceilings(choice, throttle=0.5, brake=0.0)
    found = ceilings(choice, throttle=0.5, brake=0.0, periods=knots)
    np.testing.assert_array_equal(found, every_stage[knots - 1])
