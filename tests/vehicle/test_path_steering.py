"""A car that the vehicle brakes by itself is steered along its own path."""

from math import atan, degrees, hypot, inf, nan, radians

import pytest

from rt_controller.contract.car import Car
from rt_controller.contract.limits import DEFAULT_GEOMETRY, INPUT_LIMITS
from rt_controller.contract.signals import ControlInput, PathReference, VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.vehicle.path_steering import Course, largest_brake_n, steer_along
from sim_bridge.scenario import load_scenario
from sim_bridge.session import build_car

STRAIGHT = PathReference(0.0, 0.0, 0.0, 0.0, 20.0, 0.0)
CRUISING = VehicleState(20.0, 0.0, 0.0, 0.5, 0.0, 0.0)


CHANGE_RAD = INPUT_LIMITS.rate_per_s.steer_rad * PERIOD_S


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_wheel_turns_towards_the_path_and_no_faster_than_its_rate(side):
    path = STRAIGHT._replace(c0_m=3.0 * side)
    assert steer_along(path, CRUISING, 0.0, 0.0) == pytest.approx(side * CHANGE_RAD)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_bend_is_followed_with_the_curvature_of_the_road(side):
    turning = CRUISING._replace(yaw_rate_radps=side * 0.003 * 20.0)
    angle = steer_along(STRAIGHT, turning, side * 0.003, side * 0.16)
    assert angle == pytest.approx(side * 18.5 * 0.003 * (2.91 + 0.002544 * 400.0), rel=1e-3)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_wheel_turns_against_a_slide_of_the_rear_axle(side):
    sliding = CRUISING._replace(yaw_rate_radps=side * 0.02)
    assert steer_along(STRAIGHT, sliding, 0.0, 0.0) == pytest.approx(-side * 18.5 * 0.1 * 0.02)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_wheel_stays_within_its_bounds(side):
    slow = CRUISING._replace(vx_mps=3.0)
    path = STRAIGHT._replace(c0_m=30.0 * side)
    narrow = DEFAULT_GEOMETRY._replace(lock_rad=radians(40.0))
    for geometry, bound_deg in ((narrow, 40.0), (DEFAULT_GEOMETRY, 540.0)):
        before_rad = side * radians(bound_deg - 1.0)
        found = steer_along(path, slow, 0.0, before_rad, Car(*geometry))
        assert found == pytest.approx(side * radians(bound_deg))


@pytest.mark.parametrize(
    ("vx_mps", "radius_m", "before_deg", "wheel_deg"),
    [
        (9.0, inf, 39.0, 40.0),
        (24.0, inf, 39.0, 40.0),
        (8.99, inf, 39.0, 44.0),
        (8.99, inf, 203.0, degrees(18.5 * 5.0 * (2.91 / 8.99**2 + 0.0025443))),
        (15.0, 60.0, 79.0, degrees(18.5 * (atan(2.91 / 60.0) + 0.0025443 * 225.0 / 60.0)) + 20.0),
    ],
)
def test_the_wheel_turns_further_than_40_deg_in_a_tight_bend_and_at_low_speed(
    vx_mps, radius_m, before_deg, wheel_deg
):
    state = CRUISING._replace(vx_mps=vx_mps)
    found = steer_along(STRAIGHT._replace(c0_m=30.0), state, 1.0 / radius_m, radians(before_deg))
    assert found == pytest.approx(radians(wheel_deg), rel=1e-4)


@pytest.mark.parametrize("name", ["lane_change_60", "double_lane_change", "lane_change_120"])
@pytest.mark.parametrize("begin_s", [0.6, 1.2, 2.0])
def test_a_car_that_brakes_in_a_lane_change_stays_on_its_lane(name, begin_s):
    """The path is driven by this law alone."""
    scenario = load_scenario(name)
    car = build_car(scenario)
    curvature = scenario.road.curvature_per_m
    steer_rad, brake_n, farthest_m = 0.0, 0.0, 0.0
    for tick in range(500):
        path = scenario.path_ahead(car.s_m, car.state.vx_mps)
        here_per_m = scenario.road.curvature_per_m.at(car.s_m)
        steer_rad = steer_along(path, car.state, here_per_m, steer_rad)
        if tick * PERIOD_S >= begin_s:
            brake_n = min(
                brake_n + 300.0 * PERIOD_S,
                largest_brake_n(Course(path, car.state, here_per_m), steer_rad),
            )
        throttle = 0.0 if brake_n > 0.0 else 0.1
        state = car.advance(ControlInput(throttle, brake_n, steer_rad), curvature)
        farthest_m = max(farthest_m, abs(state.ey_m - scenario.path_ahead(car.s_m, 20.0).c0_m))
        if hypot(state.vx_mps, state.vy_mps) < 0.3:
            break
    assert state.vx_mps < 0.3
    assert farthest_m < 1.0
    car.plant.close()


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(("vx_mps", "ahead_m"), [(20.0, 14.0), (8.0, 5.6), (4.0, 5.0), (0.31, 5.0)])
def test_the_wheel_leads_on_a_circle_through_the_path_at_the_preview_distance(
    side, vx_mps, ahead_m
):
    terms = (0.3, 0.02, 1e-3, -2e-5)
    path = PathReference(*(side * each for each in terms), 20.0, 0.0)
    state = VehicleState(vx_mps, side * 0.01 * vx_mps, 0.0, 0.5, side * 0.2, side * 0.015)
    there_m = 0.3 + 0.02 * ahead_m + 1e-3 * ahead_m**2 - 2e-5 * ahead_m**3
    turn_per_m = 0.001 + 2.0 * (there_m - 0.2 - 0.025 * ahead_m) / ahead_m**2
    state = state._replace(yaw_rate_radps=side * turn_per_m * vx_mps)
    expected_rad = side * 18.5 * (2.91 + 0.002545 * vx_mps**2) * turn_per_m
    found_rad = steer_along(path, state, side * 0.001, expected_rad)
    assert found_rad == pytest.approx(expected_rad, rel=1e-4)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_braked_car_turns_with_4_m_per_s2_at_most(side):
    fast = CRUISING._replace(vx_mps=25.0, yaw_rate_radps=side * 4.0 / 25.0)
    expected_rad = side * 18.5 * (2.91 + 0.002545 * 625.0) * 4.0 / 625.0
    wide = STRAIGHT._replace(c0_m=30.0 * side)
    for before_rad in (expected_rad, expected_rad + 0.05, expected_rad - 0.05):
        found_rad = steer_along(wide, fast, 0.0, before_rad)
        assert found_rad == pytest.approx(expected_rad, rel=1e-4)


@pytest.mark.parametrize(
    ("vx_mps", "c0_m", "expected_rad"),
    [
        (20.0, 0.0, 0.2 - CHANGE_RAD),
        *((vx_mps, 3.0, 0.2) for vx_mps in (0.3, 0.2, 0.0, -1.0, nan)),
        (20.0, nan, 0.2),
        (20.0, inf, 0.2),
        (0.31, 3.0, 0.2 + CHANGE_RAD),
    ],
)
def test_a_standing_car_and_one_without_a_path_keep_their_wheel(vx_mps, c0_m, expected_rad):
    found = steer_along(STRAIGHT._replace(c0_m=c0_m), CRUISING._replace(vx_mps=vx_mps), 0.0, 0.2)
    assert found == pytest.approx(expected_rad)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("vx_mps", "yaw_rate_radps", "off_m", "open_throttle", "force_n"),
    [
        (20.0, 0.0, 0.0, 0.0, 75.0),
        (20.0, 0.05, 0.2, 0.0, 75.0),
        (20.0, 0.1, 0.3, 0.0, 60.0),  # in a turn with less force
        (10.0, 0.1, 0.3, 0.0, 75.0),
        (20.0, 0.2, 0.3, 0.0, 25.0),
        (20.0, 0.3, 0.2, 0.0, 25.0),
        (20.0, 0.0, 0.7, 0.0, 35.0),  # and beside the path
        (20.0, 0.0, 0.8, 0.0, 25.0),
        (20.0, 0.0, 5.0, 0.0, 25.0),
        (20.0, 0.0, 0.0, 0.05, 81.0),  # a throttle that stays open is balanced
        (20.0, 0.0, 0.0, 1.0, 150.0),
    ],
)
def test_the_brake_force_is_75_n_and_at_least_25_n(
    side, vx_mps, yaw_rate_radps, off_m, open_throttle, force_n
):
    state = CRUISING._replace(vx_mps=vx_mps, yaw_rate_radps=side * yaw_rate_radps, ey_m=off_m)
    steer_rad = DEFAULT_GEOMETRY.steady_wheel_rad(vx_mps, side * yaw_rate_radps)
    found = largest_brake_n(Course(STRAIGHT, state, 0.0), steer_rad, open_throttle)
    assert found == pytest.approx(force_n, abs=0.2)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_car_that_does_not_turn_as_its_wheel_brakes_with_less_force(side):
    course = Course(STRAIGHT, CRUISING._replace(yaw_rate_radps=side * 0.05), 0.0)
    assert largest_brake_n(course, 0.0) == pytest.approx(60.0)
    assert largest_brake_n(course, -side * 0.1) < 60.0
    slow = Course(STRAIGHT, CRUISING._replace(vx_mps=8.9, ey_m=3.0), 0.0)
    assert largest_brake_n(slow, 0.1) == pytest.approx(60.0)  # a short stop, also beside the path
