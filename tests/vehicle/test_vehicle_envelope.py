"""The vehicle's own envelope: every rule at its limit, and any command at all."""

from math import inf, isfinite, nan, radians
from random import Random

import pytest

from rt_controller.bus.messages import Command
from rt_controller.contract.faults import NO_REFUSAL, Refusal
from rt_controller.contract.limits import DEFAULT_GEOMETRY, INPUT_LIMITS, LARGEST_LATERAL_MPS2
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, Mode
from rt_controller.contract.timing import PERIOD_S
from rt_controller.vehicle.vehicle_envelope import (
    STANDING,
    OwnMotion,
    leaves_path,
    refusals,
)

CRUISE = ControlInput(0.2, 0.0, 0.1)
MOVING = OwnMotion(20.0, 0.0, is_mission_on=True)
CHANGE_RAD = INPUT_LIMITS.rate_per_s.steer_rad * PERIOD_S


def judge(
    control: ControlInput,
    mode: Mode = Mode.NOMINAL,
    before: ControlInput = CRUISE,
    periods: int = 1,
    motion: OwnMotion = MOVING,
) -> Refusal:
    return refusals(Command(control, mode), before, periods, motion)


def test_a_command_within_all_limits_is_followed() -> None:
    assert judge(CRUISE) == NO_REFUSAL


@pytest.mark.parametrize("bad", [nan, inf, -inf])
@pytest.mark.parametrize("field", ControlInput._fields)
def test_an_input_that_is_not_finite_is_refused(field: str, bad: float) -> None:
    assert judge(CRUISE._replace(**{field: bad})) == Refusal.STEERING


@pytest.mark.parametrize(
    ("field", "value"),
    [("throttle", 1.01), ("throttle", -0.01), ("brake_n", 150.1), ("brake_n", -0.1)],
)
def test_an_input_beyond_its_bounds_is_refused(field: str, value: float) -> None:
    assert judge(NEUTRAL_INPUT._replace(**{field: value}), before=NEUTRAL_INPUT) & Refusal.STEERING


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("speed_mps", "bound_deg", "refusal"),
    [
        (0.0, 540.0, Refusal.STEERING),
        (5.0, 540.0, Refusal.STEERING),
        (10.0, 251.55, Refusal.LATERAL_ACCELERATION),
        (25.0, 57.2, Refusal.LATERAL_ACCELERATION),
    ],
)
def test_a_wheel_angle_beyond_its_bound_is_refused(
    side: float, speed_mps: float, bound_deg: float, refusal: Refusal
) -> None:
    motion = STANDING._replace(speed_mps=speed_mps)
    at_bound = NEUTRAL_INPUT._replace(steer_rad=side * radians(bound_deg))
    assert judge(at_bound, before=at_bound, motion=motion) == NO_REFUSAL
    beyond = NEUTRAL_INPUT._replace(steer_rad=side * radians(bound_deg + 0.1))
    assert judge(beyond, before=at_bound, motion=motion) == refusal


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(("periods", "allowed"), [(0, 1), (1, 1), (2, 2), (4, 4), (9, 4)])
def test_the_wheel_may_move_as_far_as_its_rate_allows_and_no_farther(
    side: float, periods: int, allowed: int
) -> None:
    change_rad = side * allowed * CHANGE_RAD
    for share, expected in ((1.0, NO_REFUSAL), (1.01, Refusal.STEERING)):
        wheel = NEUTRAL_INPUT._replace(steer_rad=share * change_rad)
        found = judge(wheel, before=NEUTRAL_INPUT, periods=periods, motion=STANDING)
        assert found == expected


def test_a_step_of_120_deg_is_refused() -> None:
    assert judge(CRUISE._replace(steer_rad=radians(120.0))) & Refusal.STEERING


@pytest.mark.parametrize(
    ("throttle", "brake_n", "expected"),
    [
        (0.2, 0.0, NO_REFUSAL),
        (0.0, 50.0, NO_REFUSAL),
        (0.0009, 50.0, NO_REFUSAL),
        (0.2, 0.14, NO_REFUSAL),
        (0.2, 0.16, Refusal.PEDALS),
        (0.0011, 50.0, Refusal.PEDALS),
    ],
)
def test_both_pedals_are_refused(throttle: float, brake_n: float, expected: Refusal) -> None:
    assert judge(CRUISE._replace(throttle=throttle, brake_n=brake_n)) == expected


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize(("throttle", "is_pressed"), [(0.0, False), (0.0009, False), (0.1, True)])
def test_throttle_is_refused_in_modes_that_do_not_accelerate(
    mode: Mode, throttle: float, is_pressed: bool
) -> None:
    is_closed = mode in (Mode.STANDBY, Mode.SAFE_STOP, Mode.STANDSTILL)
    found = judge(CRUISE._replace(throttle=throttle), mode, motion=STANDING)
    assert found == (Refusal.MODE if is_closed and is_pressed else NO_REFUSAL)


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize("speed_mps", [0.5, 20.0])
@pytest.mark.parametrize("is_mission_on", [True, False])
def test_a_moving_car_is_not_left_in_standby_before_its_mission_is_over(
    mode: Mode, speed_mps: float, is_mission_on: bool
) -> None:
    motion = OwnMotion(speed_mps, 0.0, is_mission_on)
    found = judge(CRUISE._replace(throttle=0.0), mode, motion=motion)
    is_left = mode is Mode.STANDBY and speed_mps > 1.0 and is_mission_on
    assert found == (Refusal.MODE if is_left else NO_REFUSAL)


@pytest.mark.parametrize("speed_mps", [40.0, 60.0, 90.0])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_more_lateral_acceleration_than_the_limit_is_refused(speed_mps: float, side: float) -> None:
    low, high = 0.0, radians(40.0)
    for _ in range(60):  # bisection
        middle = 0.5 * (low + high)
        is_less = DEFAULT_GEOMETRY.steady_lateral_mps2(speed_mps, middle) < LARGEST_LATERAL_MPS2
        low, high = (middle, high) if is_less else (low, middle)
    for share, expected in ((0.999, NO_REFUSAL), (1.001, Refusal.LATERAL_ACCELERATION)):
        wheel = NEUTRAL_INPUT._replace(steer_rad=side * share * low)
        assert judge(wheel, before=wheel, motion=MOVING._replace(speed_mps=speed_mps)) == expected


def test_a_slow_car_without_understeer_turns_by_its_geometry() -> None:
    expected = 2.0**2 * 0.5 / 18.5 / (2.910 + 0.0025 * 4.0)
    assert -DEFAULT_GEOMETRY.steady_lateral_mps2(2.0, -0.5) == pytest.approx(expected, rel=1e-3)


def fuzzed(rng: Random) -> float:
    kind = rng.random()
    if kind < 0.05:
        return rng.choice([nan, inf, -inf, 1e300, -1e300, 0.0, -0.0])
    return rng.choice([0.01, 1.0, 200.0]) * rng.uniform(-1.0, 1.0)


def check_fuzzed_commands(number: int) -> None:
    """What is followed obeys every limit, computed here from the numbers of the limits."""
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
        if command.mode in (Mode.STANDBY, Mode.SAFE_STOP, Mode.STANDSTILL):
            assert control.throttle <= 0.001
        v2 = motion.speed_mps**2
        lateral_mps2 = v2 * abs(control.steer_rad) / 18.5 / (2.91 + 0.002545 * v2)
        assert lateral_mps2 <= 7.505
        assert abs(control.steer_rad) <= radians(540.03)
        applied = control
    assert followed > number / 50


def test_20_000_fuzzed_commands_violate_no_limit() -> None:
    check_fuzzed_commands(20_000)


@pytest.mark.nightly
def test_1e6_fuzzed_commands_violate_no_limit() -> None:
    check_fuzzed_commands(1_000_000)


@pytest.mark.parametrize("mode", [Mode.STANDBY, Mode.NOMINAL])
def test_pedals_at_a_thousandth_of_their_travel_are_released(mode: Mode) -> None:
    released = NEUTRAL_INPUT._replace(throttle=1e-3, brake_n=50.0)
    assert judge(released, mode, NEUTRAL_INPUT, motion=STANDING) == NO_REFUSAL
    released = NEUTRAL_INPUT._replace(throttle=0.5, brake_n=0.15)
    assert judge(released, before=NEUTRAL_INPUT) == NO_REFUSAL


def test_at_1_m_per_s_a_car_does_not_move() -> None:
    for speed_mps, is_left in ((1.0, False), (1.01, True)):
        motion = OwnMotion(speed_mps, 0.6, is_mission_on=True)
        found = judge(NEUTRAL_INPUT, Mode.STANDBY, NEUTRAL_INPUT, motion=motion)
        assert found == (Refusal.MODE if is_left else NO_REFUSAL)
        assert leaves_path(Command(NEUTRAL_INPUT, Mode.SAFE_STOP), motion, True) is is_left


@pytest.mark.parametrize(
    ("field", "bound", "step"),
    [
        ("throttle", 1.0, 2e-5),
        ("throttle", 0.0, -2e-5),
        ("brake_n", 150.0, 2.5e-3),
        ("brake_n", 0.0, -2.5e-3),
    ],
)
def test_a_frame_may_round_by_one_step_beyond_a_bound(
    field: str, bound: float, step: float
) -> None:
    for share, expected in ((0.9, NO_REFUSAL), (1.0, NO_REFUSAL), (1.1, Refusal.STEERING)):
        control = NEUTRAL_INPUT._replace(**{field: bound + share * step})
        assert judge(control, before=NEUTRAL_INPUT) == expected


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("before_deg", [-10.0, 0.0, 10.0])
def test_the_wheel_may_move_by_5_deg_a_period_and_two_steps_of_the_frame(
    side: float, before_deg: float
) -> None:
    before = NEUTRAL_INPUT._replace(steer_rad=radians(before_deg))
    for change_deg, expected in ((5.0399, NO_REFUSAL), (5.0401, Refusal.STEERING)):
        wheel = before._replace(steer_rad=before.steer_rad + side * radians(change_deg))
        assert judge(wheel, before=before, motion=STANDING) == expected


@pytest.mark.parametrize("speed_mps", [10.0, 30.0])
def test_the_lateral_acceleration_is_that_of_the_single_track_model(speed_mps: float) -> None:
    squared = speed_mps**2
    expected = squared * 0.4 / 18.5 / (2.91 + radians(1.43) / 9.81 * squared)
    for side in (-1.0, 1.0):
        found = abs(DEFAULT_GEOMETRY.steady_lateral_mps2(speed_mps, side * 0.4))
        assert found == pytest.approx(expected, rel=1e-3)


def test_the_largest_change_of_the_wheel_is_allowed() -> None:
    largest_rad = CHANGE_RAD * 1 + 2.0 * radians(0.02)
    wheel = NEUTRAL_INPUT._replace(steer_rad=largest_rad)
    assert judge(wheel, before=NEUTRAL_INPUT, motion=STANDING) == NO_REFUSAL


def test_a_standing_car_is_on_its_path_and_requests_to_be_driven() -> None:
    assert STANDING == (0.0, 0.0, True)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_exactly_7_5_m_per_s2_are_allowed(side: float) -> None:
    low, high = 0.0, radians(40.0)
    while (middle := 0.5 * (low + high)) not in (low, high):
        is_less = DEFAULT_GEOMETRY.steady_lateral_mps2(40.0, middle) < 7.5
        low, high = (middle, high) if is_less else (low, middle)
    assert DEFAULT_GEOMETRY.steady_lateral_mps2(40.0, high) == 7.5
    wheel = NEUTRAL_INPUT._replace(steer_rad=side * high)
    found = judge(wheel, before=wheel, motion=MOVING._replace(speed_mps=40.0))
    assert found == NO_REFUSAL
