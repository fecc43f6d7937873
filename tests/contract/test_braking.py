"""The brake of a stop: with the grip that the cornering leaves, and enough to slow down."""

from math import inf

import pytest

from rt_controller.contract.braking import brake_beside_n, least_brake_n, stop_speed_mps
from rt_controller.contract.limits import DEFAULT_GEOMETRY
from rt_controller.contract.signals import AT_REST

STRAIGHT = AT_REST._replace(vx_mps=20.0)


@pytest.mark.parametrize(
    ("before_mps", "vx_mps", "periods", "expected_mps"),
    [(inf, 20.0, 1, 19.98), (19.0, 20.0, 1, 18.98), (20.0, 19.0, 1, 18.98), (inf, 20.0, 3, 19.94)],
)
def test_a_stop_slows_down_by_0_8_mps2_at_least(before_mps, vx_mps, periods, expected_mps):
    assert stop_speed_mps(before_mps, vx_mps, periods) == pytest.approx(expected_mps)


@pytest.mark.parametrize(
    ("vx_mps", "stop_mps", "expected_n"),
    [
        (20.0, inf, 25.0),
        (20.0, 20.0, 25.0),
        (20.0, 19.7, 25.0),
        (20.0, 19.5, 29.0),
        (20.0, 19.0, 39.0),
        (20.0, 15.0, 60.0),
        (9.0, inf, 25.0),
        (8.99, inf, 60.0),
    ],
)
def test_the_least_force_grows_with_the_speed_above_that_of_the_stop(vx_mps, stop_mps, expected_n):
    assert least_brake_n(vx_mps, stop_mps) == pytest.approx(expected_n)


def turning(lateral_mps2, wheel_mps2):
    """State and wheel of a car whose wheel asks for another lateral acceleration than it has."""
    per_rad = DEFAULT_GEOMETRY.steady_lateral_mps2(STRAIGHT.vx_mps, 1.0)
    return STRAIGHT._replace(yaw_rate_radps=lateral_mps2 / STRAIGHT.vx_mps), wheel_mps2 / per_rad


@pytest.mark.parametrize(
    ("lateral_mps2", "wheel_mps2", "expected_n"),
    [
        (0.0, 0.0, 75.0),
        (1.0, 1.0, 75.0),
        (2.0, 2.0, 60.0),
        (-2.0, -2.0, 60.0),
        (3.5, 3.5, 30.0),
        (5.0, 5.0, 25.0),
        (1.0, 2.0, 40.0),  # the car turns less than its wheel, then more
        (2.0, 1.0, 40.0),
        (-1.0, 1.0, 40.0),
    ],
)
def test_a_car_that_turns_or_slides_brakes_less(lateral_mps2, wheel_mps2, expected_n):
    state, steer_rad = turning(lateral_mps2, wheel_mps2)
    assert brake_beside_n(state, steer_rad, DEFAULT_GEOMETRY) == pytest.approx(expected_n)


@pytest.mark.parametrize(
    ("changes", "expected_n"),
    [
        ({"open_throttle": 0.1}, 87.0),
        ({"open_throttle": -0.1}, 75.0),
        ({"open_throttle": 1.0}, 150.0),
        ({"most_n": 100.0}, 100.0),
        ({"most_n": 50.0}, 50.0),
    ],
)
def test_an_open_throttle_needs_more_brake(changes, expected_n):
    found = brake_beside_n(STRAIGHT, 0.0, DEFAULT_GEOMETRY, **changes)
    assert found == pytest.approx(expected_n)
