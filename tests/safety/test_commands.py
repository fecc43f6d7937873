"""What is sent: limited, ramped to a stop, and compared with what the actuators show."""

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from rt_controller.contract.faults import StopCause
from rt_controller.contract.limits import DEFAULT_GEOMETRY, INPUT_LIMITS
from rt_controller.contract.signals import AT_REST, NEUTRAL_INPUT, ControlInput, Mode
from rt_controller.contract.timing import PERIOD_S
from rt_controller.safety.envelope import limit
from rt_controller.safety.sent_commands import MEMORY_PERIODS, SentCommands
from rt_controller.safety.stop import (
    ALONG_PATH,
    FULL,
    LOST,
    Braking,
    braking_for,
    input_for,
    safe_stop,
    stand_by,
)

anything = st.floats(allow_nan=True, allow_infinity=True)
wanted_inputs = st.builds(ControlInput, anything, anything, anything)
pedal = st.one_of(
    st.tuples(st.floats(0.0, 1.0), st.just(0.0)), st.tuples(st.just(0.0), st.floats(0.0, 150.0))
)
previous_inputs = st.builds(
    lambda pedals, steer: ControlInput(*pedals, steer),
    pedal,
    st.floats(INPUT_LIMITS.lower.steer_rad, INPUT_LIMITS.upper.steer_rad),
)


@given(wanted_inputs, previous_inputs)
@example(ControlInput(math.nan, math.nan, math.nan), ControlInput(0.5, 0.0, 0.3))
@example(ControlInput(1.0, 150.0, 9.0), NEUTRAL_INPUT)
def test_every_command_is_finite_within_bounds_and_on_one_pedal(wanted, previous):
    out = limit(wanted, previous)
    for value, low, high in zip(out, INPUT_LIMITS.lower, INPUT_LIMITS.upper, strict=True):
        assert low <= value <= high
    assert out.throttle == 0.0 or out.brake_n == 0.0


@given(wanted_inputs, previous_inputs)
def test_no_input_changes_faster_than_its_rate(wanted, previous):
    out = limit(wanted, previous)
    rate = INPUT_LIMITS.rate_per_s
    assert out.throttle - previous.throttle <= rate.throttle * PERIOD_S + 1e-9
    assert out.brake_n - previous.brake_n <= rate.brake_n * PERIOD_S + 1e-9
    assert abs(out.steer_rad - previous.steer_rad) <= rate.steer_rad * PERIOD_S + 1e-9


NOTHING = (math.nan, math.inf, -math.inf)


@pytest.mark.parametrize(
    ("wanted", "previous", "expected"),
    [
        ((0.21, 0.0, 0.05), (0.2, 0.0, 0.04), (0.21, 0.0, 0.05)),  # within all limits
        (NOTHING, (0.3, 0.0, 0.2), (0.3, 0.0, 0.2)),  # the last command is repeated
        ((0.0, 0.0, 0.0), (0.8, 0.0, 0.0), (0.0, 0.0, 0.0)),  # the throttle closes at once
        ((-0.1, 0.0, 0.0), (0.8, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((0.0, 50.0, 0.0), (0.8, 0.0, 0.0), (0.0, 12.5, 0.0)),  # and the brake is pressed with it
        ((0.5, 50.0, 0.0), (0.6, 0.0, 0.0), (0.5375, 0.0, 0.0)),  # the pedal in use stays
        ((0.5, 50.0, 0.0), (0.0, 0.0, 0.0), (0.0, 12.5, 0.0)),  # the brake has priority
        ((0.5, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0625, 0.0, 0.0)),
        # less than a thousandth of a pedal is released
        ((0.9e-3, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((1e-3, 0.0, 0.0), (0.0, 0.0, 0.0), (1e-3, 0.0, 0.0)),
        ((1.1e-3, 0.0, 0.0), (0.0, 0.0, 0.0), (1.1e-3, 0.0, 0.0)),
        ((0.0, 0.149, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((0.0, 0.15, 0.0), (0.0, 0.0, 0.0), (0.0, 0.15, 0.0)),
        ((0.0, 0.2, 0.0), (0.0, 0.0, 0.0), (0.0, 0.2, 0.0)),
    ],
)
def test_a_wanted_input_is_limited_on_one_pedal(wanted, previous, expected):
    assert limit(ControlInput(*wanted), ControlInput(*previous)) == expected


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_wheel_turns_at_200_deg_per_s_to_40_deg(side):
    wanted = NEUTRAL_INPUT._replace(steer_rad=9.0 * side)
    control, angles = NEUTRAL_INPUT, []
    for _ in range(9):
        control = limit(wanted, control)
        angles.append(side * math.degrees(control.steer_rad))
    assert angles == pytest.approx([5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 40.0])


def test_a_safe_stop_ramps_the_brake_to_its_maximum_and_holds_it():
    control = ControlInput(0.6, 0.0, 0.4)
    forces = []
    for _ in range(200):
        control = safe_stop(control, None, is_held=False)
        forces.append(control.brake_n)
        assert control.throttle == 0.0
    assert forces[0] == pytest.approx(ALONG_PATH.rate_n_per_s * PERIOD_S)
    assert forces == sorted(forces)
    assert forces[-1] == ALONG_PATH.most_n


def test_the_steering_follows_the_rest_of_the_plan_then_returns_to_zero():
    planned = ControlInput(0.3, 0.0, 0.38)
    control = safe_stop(ControlInput(0.0, 0.0, 0.4), planned, is_held=False)
    assert control.steer_rad == 0.38
    for _ in range(100):
        returned = safe_stop(control, None, is_held=False)
        assert 0.0 <= returned.steer_rad <= control.steer_rad
        control = returned
    assert control.steer_rad == 0.0


def test_a_larger_brake_force_is_not_reduced():
    assert safe_stop(ControlInput(0.0, 60.0, 0.0), None, is_held=False).brake_n > 60.0


def test_the_brake_of_a_held_car_is_not_released_and_pressed_as_planned():
    held = ControlInput(0.0, 120.0, 0.1)
    assert safe_stop(held, None, is_held=True).brake_n == 120.0
    assert safe_stop(held, held._replace(brake_n=123.75), is_held=True).brake_n == 123.75
    assert safe_stop(held, held, is_held=False).brake_n == ALONG_PATH.most_n


@pytest.mark.parametrize(
    ("steer_rad", "expected_rad"),
    [(0.5, 0.4825), (-0.5, -0.4825), (0.01, 0.0), (-0.01, 0.0), (0.0, 0.0)],
)
def test_standby_releases_the_pedals_and_returns_the_wheel_at_40_deg_per_s(steer_rad, expected_rad):
    assert stand_by(ControlInput(0.3, 0.0, steer_rad)) == pytest.approx((0.0, 0.0, expected_rad))


def test_a_driven_mode_sends_the_plan_and_without_one_a_safe_stop():
    previous, planned = ControlInput(0.2, 0.0, 0.1), ControlInput(0.3, 0.0, 0.2)
    for mode in (Mode.NOMINAL, Mode.HOLD_PLAN):
        assert input_for(mode, planned, previous, is_held=False) == planned
        assert input_for(mode, None, previous, False) == safe_stop(previous, None, False)
    stopped = input_for(Mode.SAFE_STOP, planned, previous, is_held=False)
    assert stopped == safe_stop(previous, planned, is_held=False)
    assert input_for(Mode.STANDBY, planned, previous, is_held=False) == stand_by(previous)


def turning(lateral_mps2, vx_mps=20.0):
    """A car that turns as its wheel, and the wheel."""
    state = AT_REST._replace(vx_mps=vx_mps, yaw_rate_radps=lateral_mps2 / vx_mps)
    return state, DEFAULT_GEOMETRY.steady_wheel_rad(vx_mps, state.yaw_rate_radps)


@pytest.mark.parametrize(
    ("cause", "is_known", "turn", "more", "braking"),
    [
        (StopCause.STATE_LOST, True, turning(0.0), {}, ALONG_PATH),
        (StopCause.NONE, True, turning(1.0), {}, ALONG_PATH),
        (StopCause.NONE, True, turning(-3.0), {}, Braking(40.0, 150.0)),
        # a car that slides needs the grip of what it does and of what its wheel asks for
        (StopCause.NONE, True, (turning(1.0)[0], turning(2.0)[1]), {}, Braking(40.0, 150.0)),
        (StopCause.NONE, True, (turning(1.0)[0], turning(-1.0)[1]), {}, Braking(40.0, 150.0)),
        (StopCause.NONE, True, turning(4.0, 8.9), {}, Braking(60.0, 150.0)),
        (StopCause.NONE, True, turning(5.0), {"stop_mps": 18.7}, Braking(45.0, 150.0)),
        (StopCause.REFERENCE_LOST, False, turning(0.0), {}, LOST),
        (StopCause.REFERENCE_LOST, False, turning(-3.0), {}, Braking(40.0, 300.0)),
        (StopCause.STATE_FROZEN, False, turning(5.0), {}, Braking(25.0, 300.0)),
        (StopCause.STEERING_MISMATCH, True, turning(5.0), {}, FULL),
        (StopCause.STEERING_MISMATCH, True, turning(5.0), {"force_scale": 2.0}, FULL),
        (StopCause.NONE, True, turning(0.0), {"open_throttle": 0.05}, Braking(81.0, 150.0)),
        (StopCause.NONE, True, turning(3.0), {"open_throttle": 0.05}, Braking(46.0, 150.0)),
        (StopCause.NONE, True, turning(0.0), {"open_throttle": 1.0}, Braking(150.0, 150.0)),
        (StopCause.STEERING_MISMATCH, True, turning(0.0), {"is_held": True}, ALONG_PATH),
    ],
)
def test_a_stop_is_as_short_as_its_cause_demands_and_the_grip_allows(
    cause, is_known, turn, more, braking
):
    assert braking_for(cause, is_known, *turn, **more) == pytest.approx(braking, rel=1e-3)


@pytest.mark.parametrize(
    ("braking", "most_n", "rate_n_per_s"),
    [(ALONG_PATH, 75.0, 150.0), (LOST, 100.0, 300.0), (FULL, 150.0, 500.0)],
)
def test_the_brake_is_ramped_to_the_documented_force_of_the_stop(braking, most_n, rate_n_per_s):
    assert braking == (most_n, rate_n_per_s)
    first = input_for(Mode.SAFE_STOP, None, NEUTRAL_INPUT, False, braking)
    assert first.brake_n == pytest.approx(0.025 * rate_n_per_s)
    pressed = NEUTRAL_INPUT._replace(brake_n=most_n)
    assert input_for(Mode.SAFE_STOP, None, pressed, False, braking).brake_n == most_n


@pytest.mark.parametrize("planned", [None, NEUTRAL_INPUT])
def test_a_held_car_is_braked_as_along_the_path(planned):
    held = braking_for(StopCause.STEERING_MISMATCH, True, AT_REST, 0.0, is_held=True)
    assert input_for(Mode.SAFE_STOP, planned, NEUTRAL_INPUT, True, held).brake_n == 3.75


CRUISE = ControlInput(0.2, 0.0, 0.1)


def test_a_feedback_within_the_range_of_the_commands_has_no_distance():
    commands = SentCommands()
    commands.add(CRUISE)
    for share in (0.0, 0.5, 1.0):
        between = ControlInput(*(share * value for value in CRUISE))
        assert commands.outside(between) == ControlInput(0.0, 0.0, 0.0)


def test_the_distance_is_that_to_the_nearer_end_of_the_range_input_by_input():
    commands = SentCommands()
    commands.add(ControlInput(0.2, 30.0, 0.1))
    assert commands.outside(ControlInput(0.5, 70.0, -0.3)) == pytest.approx((0.3, 40.0, 0.3))
    assert commands.outside(ControlInput(-0.1, -5.0, 0.4)) == pytest.approx((0.1, 5.0, 0.3))


def test_a_command_is_forgotten_after_six_periods():
    commands = SentCommands()
    commands.add(CRUISE._replace(steer_rad=0.5))
    for _ in range(5):
        commands.add(NEUTRAL_INPUT)
    assert commands.outside(CRUISE._replace(steer_rad=0.5)).steer_rad == 0.0
    commands.add(NEUTRAL_INPUT)
    assert commands.outside(CRUISE._replace(steer_rad=0.5)).steer_rad == 0.5


def test_with_a_configured_delay_older_commands_are_compared():
    commands = SentCommands(actuation_periods=5)
    commands.add(CRUISE)
    for _ in range(9):
        commands.add(NEUTRAL_INPUT)
    assert commands.outside(CRUISE) == ControlInput(0.0, 0.0, 0.0)
    commands.add(NEUTRAL_INPUT)
    assert commands.outside(CRUISE) == pytest.approx(CRUISE)


def test_a_wheel_that_is_known_to_be_late_is_compared_with_older_commands():
    commands = SentCommands()
    commands.add(CRUISE)
    for _ in range(MEMORY_PERIODS + 3):
        commands.add(NEUTRAL_INPUT)
    assert commands.outside(CRUISE, late_periods=3) == pytest.approx((0.2, 0.0, 0.1))
    assert commands.outside(CRUISE, late_periods=4) == pytest.approx((0.2, 0.0, 0.0))
    for late_by, expected_rad in ((15, 0.0), (16, 0.1)):  # but with 400 ms of them at most
        commands = SentCommands()
        for command in (CRUISE, *[NEUTRAL_INPUT] * late_by):
            commands.add(command)
        assert commands.outside(CRUISE, late_periods=20).steer_rad == pytest.approx(expected_rad)


def test_a_command_is_found_under_its_counter_with_the_ones_before_it():
    sent = SentCommands()
    assert sent.until(15, 3) == []
    for counter in range(100, 140):  # modulo 128
        sent.add(CRUISE._replace(steer_rad=0.01 * counter), counter % 128)
    found = sent.until(11, 3)
    assert [each.steer_rad for each in found] == pytest.approx([1.39, 1.38, 1.37])
    sent.add(NEUTRAL_INPUT, 11)  # a repeated one is dropped by its receiver
    assert sent.until(11, 1) == [found[0]]
    sent.add(NEUTRAL_INPUT, 13)
    assert sent.until(13, 3) == [NEUTRAL_INPUT]
    assert sent.until(12, 3) == []
