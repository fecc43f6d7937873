"""For any wanted input, the limited one is finite, within bounds, slew-limited, on one pedal."""

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput
from rt_controller.contract.timing import PERIOD_S
from rt_controller.safety.envelope import limit

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
def test_every_command_is_finite_within_bounds_and_on_one_pedal(
    wanted: ControlInput, previous: ControlInput
) -> None:
    out = limit(wanted, previous)
    for value, low, high in zip(out, INPUT_LIMITS.lower, INPUT_LIMITS.upper, strict=True):
        assert low <= value <= high
    assert out.throttle == 0.0 or out.brake_n == 0.0


@given(wanted_inputs, previous_inputs)
def test_no_input_changes_faster_than_its_rate(
    wanted: ControlInput, previous: ControlInput
) -> None:
    out = limit(wanted, previous)
    rate = INPUT_LIMITS.rate_per_s
    assert out.throttle - previous.throttle <= rate.throttle * PERIOD_S + 1e-9
    assert out.brake_n - previous.brake_n <= rate.brake_n * PERIOD_S + 1e-9
    assert abs(out.steer_rad - previous.steer_rad) <= rate.steer_rad * PERIOD_S + 1e-9


def test_an_input_within_all_limits_is_unchanged() -> None:
    wanted = ControlInput(0.21, 0.0, 0.05)
    assert limit(wanted, ControlInput(0.2, 0.0, 0.04)) == wanted


def test_a_wanted_throttle_of_zero_closes_it_at_once() -> None:
    assert limit(NEUTRAL_INPUT, ControlInput(0.8, 0.0, 0.0)).throttle == 0.0


def test_the_brake_stays_released_while_the_throttle_is_pressed() -> None:
    out = limit(ControlInput(0.5, 50.0, 0.0), ControlInput(0.6, 0.0, 0.0))
    assert out.throttle > 0.0
    assert out.brake_n == 0.0


def test_the_brake_has_priority_if_neither_pedal_was_pressed() -> None:
    out = limit(ControlInput(0.5, 50.0, 0.0), NEUTRAL_INPUT)
    assert out.throttle == 0.0
    assert out.brake_n > 0.0


def test_values_that_are_not_finite_repeat_the_last_command() -> None:
    previous = ControlInput(0.3, 0.0, 0.2)
    assert limit(ControlInput(math.nan, math.inf, -math.inf), previous) == previous


def test_a_wanted_throttle_below_zero_closes_it_at_once() -> None:
    assert limit(ControlInput(-0.1, 0.0, 0.0), ControlInput(0.8, 0.0, 0.0)).throttle == 0.0


def test_the_brake_is_pressed_in_the_tick_that_closes_the_throttle() -> None:
    out = limit(ControlInput(0.0, 50.0, 0.0), ControlInput(0.8, 0.0, 0.0))
    assert (out.throttle, out.brake_n) == (0.0, 12.5)


def test_the_throttle_is_pressed_from_rest() -> None:
    out = limit(ControlInput(0.5, 0.0, 0.0), NEUTRAL_INPUT)
    assert (out.throttle, out.brake_n) == (0.0625, 0.0)


@pytest.mark.parametrize(("throttle", "expected"), [(0.9e-3, 0.0), (1e-3, 1e-3), (1.1e-3, 1.1e-3)])
def test_a_thousandth_of_the_throttle_is_released(throttle: float, expected: float) -> None:
    assert limit(NEUTRAL_INPUT._replace(throttle=throttle), NEUTRAL_INPUT).throttle == expected


@pytest.mark.parametrize(("brake_n", "expected"), [(0.149, 0.0), (0.15, 0.15), (0.2, 0.2)])
def test_a_thousandth_of_the_brake_is_released(brake_n: float, expected: float) -> None:
    assert limit(NEUTRAL_INPUT._replace(brake_n=brake_n), NEUTRAL_INPUT).brake_n == expected


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_wheel_turns_at_200_deg_per_s_to_40_deg(side: float) -> None:
    wanted = NEUTRAL_INPUT._replace(steer_rad=9.0 * side)
    control, angles = NEUTRAL_INPUT, []
    for _ in range(9):
        control = limit(wanted, control)
        angles.append(side * math.degrees(control.steer_rad))
    assert angles == pytest.approx([5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 40.0])
