"""The vehicle's own envelope: every rule at its limit, any command at all, and leaving the path."""

from math import inf, isfinite, nan, radians
from random import Random

import pytest

from rt_controller.bus.messages import Command
from rt_controller.contract.faults import NO_REFUSAL, Refusal
from rt_controller.contract.limits import DEFAULT_GEOMETRY, INPUT_LIMITS
from rt_controller.contract.signals import (
    NEUTRAL_INPUT,
    ControlInput,
    Mode,
    PathReference,
    VehicleState,
)
from rt_controller.contract.timing import PERIOD_S
from rt_controller.vehicle.vehicle_envelope import (
    STANDING,
    OwnMotion,
    leaves_path,
    off_path_m,
    refusals,
)
from sim_bridge.scenario import load_scenario
from sim_bridge.scenario_run import ScenarioRun

CRUISE = ControlInput(0.2, 0.0, 0.1)
MOVING = OwnMotion(20.0, 0.0, is_mission_on=True)
SIDES = pytest.mark.parametrize("side", [-1.0, 1.0])
WITHOUT_THROTTLE = (Mode.STANDBY, Mode.SAFE_STOP, Mode.STANDSTILL)


def judge(
    control: ControlInput,
    mode: Mode = Mode.NOMINAL,
    before: ControlInput = CRUISE,
    periods: int = 1,
    motion: OwnMotion = MOVING,
) -> Refusal:
    return refusals(Command(control, mode), before, periods, motion)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, NO_REFUSAL),
        ({"throttle": 0.0, "brake_n": 50.0}, NO_REFUSAL),
        ({"throttle": 1e-3, "brake_n": 50.0}, NO_REFUSAL),  # a thousandth is released
        ({"throttle": 0.0011, "brake_n": 50.0}, Refusal.PEDALS),
        ({"brake_n": 0.15}, NO_REFUSAL),
        ({"brake_n": 0.16}, Refusal.PEDALS),
        *(({name: bad}, Refusal.STEERING) for name in CRUISE._fields for bad in (nan, inf, -inf)),
        # A frame may round by one step beyond a bound.
        ({"throttle": 1.0 + 2.0e-5}, NO_REFUSAL),
        ({"throttle": 1.0 + 2.2e-5}, Refusal.STEERING),
        ({"throttle": -2.0e-5}, NO_REFUSAL),
        ({"throttle": -2.2e-5}, Refusal.STEERING),
        ({"throttle": 0.0, "brake_n": 150.0 + 2.5e-3}, NO_REFUSAL),
        ({"throttle": 0.0, "brake_n": 150.0 + 2.8e-3}, Refusal.STEERING),
        ({"brake_n": -2.5e-3}, NO_REFUSAL),
        ({"brake_n": -2.8e-3}, Refusal.STEERING),
    ],
)
def test_pedals_are_refused_beyond_their_bounds_and_both_at_once(changes, expected):
    assert judge(CRUISE._replace(**changes)) == expected


@SIDES
@pytest.mark.parametrize("before_deg", [-10.0, 0.0, 10.0])
@pytest.mark.parametrize(("periods", "allowed"), [(0, 1), (1, 1), (2, 2), (4, 4), (9, 4)])
def test_the_wheel_may_move_by_5_deg_a_period_and_two_steps_of_the_frame(
    side, before_deg, periods, allowed
):
    before = NEUTRAL_INPUT._replace(steer_rad=radians(before_deg))
    for more_deg, expected in ((0.0399, NO_REFUSAL), (0.0401, Refusal.STEERING)):
        change_rad = side * radians(5.0 * allowed + more_deg)
        wheel = before._replace(steer_rad=before.steer_rad + change_rad)
        assert judge(wheel, before=before, periods=periods, motion=STANDING) == expected


@SIDES
@pytest.mark.parametrize(
    ("speed_mps", "bound_deg", "refusal"),
    [
        (0.0, 540.0, Refusal.STEERING),
        (5.0, 540.0, Refusal.STEERING),
        (10.0, 251.55, Refusal.LATERAL_ACCELERATION),
        (25.0, 57.2, Refusal.LATERAL_ACCELERATION),
    ],
)
def test_a_wheel_angle_beyond_its_bound_is_refused(side, speed_mps, bound_deg, refusal):
    motion = STANDING._replace(speed_mps=speed_mps)
    at_bound = NEUTRAL_INPUT._replace(steer_rad=side * radians(bound_deg))
    assert judge(at_bound, before=at_bound, motion=motion) == NO_REFUSAL
    beyond = NEUTRAL_INPUT._replace(steer_rad=side * radians(bound_deg + 0.1))
    assert judge(beyond, before=at_bound, motion=motion) == refusal


@SIDES
@pytest.mark.parametrize("speed_mps", [40.0, 60.0, 90.0])
def test_more_than_7_5_m_per_s2_are_refused_and_exactly_that_is_allowed(side, speed_mps):
    """The acceleration is that of the single-track model."""
    low, high = 0.0, radians(40.0)
    while (middle := 0.5 * (low + high)) not in (low, high):
        is_less = DEFAULT_GEOMETRY.steady_lateral_mps2(speed_mps, middle) < 7.5
        low, high = (middle, high) if is_less else (low, middle)
    squared = speed_mps**2
    by_hand_mps2 = squared * high / 18.5 / (2.91 + radians(1.43) / 9.81 * squared)
    assert by_hand_mps2 == pytest.approx(7.5, rel=1e-3)
    for share, expected in ((1.0, NO_REFUSAL), (1.001, Refusal.LATERAL_ACCELERATION)):
        wheel = NEUTRAL_INPUT._replace(steer_rad=side * share * (high if speed_mps == 40 else low))
        assert judge(wheel, before=wheel, motion=MOVING._replace(speed_mps=speed_mps)) == expected


@pytest.mark.parametrize("mode", Mode)
def test_throttle_and_standby_are_refused_where_they_do_not_belong(mode):
    """Throttle in modes that do not accelerate; a moving car left alone before its mission ends."""
    for throttle, is_pressed in ((0.0, False), (1e-3, False), (0.1, True)):
        found = judge(CRUISE._replace(throttle=throttle), mode, motion=STANDING)
        is_refused = is_pressed and mode in WITHOUT_THROTTLE
        assert found == (Refusal.MODE if is_refused else NO_REFUSAL)
    for speed_mps in (0.5, 1.0, 1.01, 20.0):
        for is_mission_on in (True, False):
            motion = OwnMotion(speed_mps, 0.0, is_mission_on)
            is_left = mode is Mode.STANDBY and speed_mps > 1.0 and is_mission_on
            found = judge(CRUISE._replace(throttle=0.0), mode, motion=motion)
            assert found == (Refusal.MODE if is_left else NO_REFUSAL)


def test_exactly_the_largest_change_of_the_wheel_is_allowed():
    largest_rad = INPUT_LIMITS.rate_per_s.steer_rad * PERIOD_S + 2.0 * radians(0.02)
    wheel = NEUTRAL_INPUT._replace(steer_rad=largest_rad)
    assert judge(wheel, before=NEUTRAL_INPUT, motion=STANDING) == NO_REFUSAL


def test_a_standing_car_is_on_its_path_and_requests_to_be_driven():
    assert STANDING == (0.0, 0.0, True)


def fuzzed(rng: Random) -> float:
    if rng.random() < 0.05:
        return rng.choice([nan, inf, -inf, 1e300, -1e300, 0.0, -0.0])
    return rng.choice([0.01, 1.0, 200.0]) * rng.uniform(-1.0, 1.0)


@pytest.mark.parametrize(
    "number", [20_000, pytest.param(1_000_000, marks=pytest.mark.nightly)], ids=["short", "long"]
)
def test_fuzzed_commands_that_are_followed_violate_no_limit(number):
    """The limits are computed here from their numbers."""
    rng = Random(3)
    applied, followed = NEUTRAL_INPUT, 0
    modes = list(Mode)
    for _ in range(number):
        near = rng.random() < 0.5
        wheel = applied.steer_rad + rng.uniform(-0.12, 0.12) if near else fuzzed(rng)
        pedals = (rng.random(), 0.0) if near else (fuzzed(rng), fuzzed(rng))
        control = ControlInput(*pedals, wheel)
        motion = OwnMotion(rng.uniform(0.0, 60.0), 0.0, is_mission_on=rng.random() < 0.5)
        command = Command(control, rng.choice(modes))
        if refusals(command, applied, 1, motion):
            continue
        followed += 1
        assert all(map(isfinite, control))
        assert -1e-4 <= control.throttle <= 1.0001
        assert -0.01 <= control.brake_n <= 150.01
        assert abs(control.steer_rad - applied.steer_rad) <= radians(200.0 * 0.025 + 0.041)
        assert not (control.throttle > 0.001 and control.brake_n > 0.15)
        assert control.throttle <= 0.001 or command.mode not in WITHOUT_THROTTLE
        v2 = motion.speed_mps**2
        assert v2 * abs(control.steer_rad) / 18.5 / (2.91 + 0.002545 * v2) <= 7.505
        assert abs(control.steer_rad) <= radians(540.03)
        applied = control
    assert followed > number / 50


@SIDES
@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize("has_reached_path", [True, False])
@pytest.mark.parametrize("is_mission_on", [True, False])
def test_a_safe_stop_leaves_the_path_at_half_a_metre_and_a_drive_at_90_cm(
    side, mode, has_reached_path, is_mission_on
):
    """Only while the car moves; before it has reached its path, and without mission, no drive."""
    is_driven = mode not in (Mode.STANDBY, Mode.SAFE_STOP) and is_mission_on and has_reached_path
    for off_m in (0.5, 0.51, 0.9, 0.91):
        for speed_mps in (0.5, 1.0, 1.01, 20.0):
            motion = OwnMotion(speed_mps, side * off_m, is_mission_on)
            is_far = (mode is Mode.SAFE_STOP and off_m > 0.5) or (is_driven and off_m > 0.9)
            found = leaves_path(Command(CRUISE, mode), motion, has_reached_path)
            assert found is (is_far and speed_mps > 1.0)


@SIDES
def test_a_car_is_as_far_off_its_path_as_it_will_be_in_0_3_s(side):
    state = VehicleState(20.0, 0.0, 0.0, 0.5, side * 0.1, side * 0.05)
    run = ScenarioRun(load_scenario("straight"), state, 0.0)
    assert run.motion == pytest.approx((20.0, side * (0.1 + 20.0 * 0.05 * 0.3), True))
    turning_m = 0.1 + 0.3 * (20.0 * 0.05 + 0.5) + 0.5 * 0.3**2 * 20.0 * 0.2
    # One that turns back may overshoot: its heading counts.
    for vy_mps, yaw_rate_radps, off_m in ((0.5, 0.2, turning_m), (0.0, -0.4, 0.4)):
        moving = state._replace(vy_mps=side * vy_mps, yaw_rate_radps=side * yaw_rate_radps)
        run = ScenarioRun(load_scenario("straight"), moving, 0.0)
        assert run.motion.off_path_m == pytest.approx(side * off_m)


@SIDES
@pytest.mark.parametrize(
    ("yaw_rate_radps", "expected_m"),
    [(0.05, 0.66499), (-0.1, 0.60199)],  # by the motion, and by the heading
)
def test_the_deviation_ahead_is_the_larger_one_of_heading_and_motion(
    side, yaw_rate_radps, expected_m
):
    """0.3 m beside the path, which is met at 20 m/s with 0.15 rad - atan(0.1)."""
    path = PathReference(0.2 * side, 0.1 * side, 0.001 * side, 0.0, 20.0, 0.0)
    state = VehicleState(20.0, 0.3 * side, yaw_rate_radps * side, 0.5, 0.5 * side, 0.15 * side)
    found_m = off_path_m(path, state, 0.002 * side)
    assert found_m == pytest.approx(expected_m * side, abs=1e-4)
