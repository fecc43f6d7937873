"""An actuator's feedback has to lie in the range of the commands of the last 150 ms."""

import pytest

from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput
from rt_controller.safety.actuators import MEMORY_TICKS, CommandRange

CRUISE = ControlInput(0.2, 0.0, 0.1)


def test_a_feedback_within_the_range_of_the_commands_has_no_distance() -> None:
    commands = CommandRange()
    commands.add(CRUISE)
    for share in (0.0, 0.5, 1.0):
        between = ControlInput(*(share * value for value in CRUISE))
        assert commands.distance(between) == ControlInput(0.0, 0.0, 0.0)


def test_the_distance_is_that_to_the_nearer_end_of_the_range_input_by_input() -> None:
    commands = CommandRange()
    commands.add(ControlInput(0.2, 30.0, 0.1))
    assert commands.distance(ControlInput(0.5, 70.0, -0.3)) == pytest.approx((0.3, 40.0, 0.3))
    assert commands.distance(ControlInput(-0.1, -5.0, 0.4)) == pytest.approx((0.1, 5.0, 0.3))


def test_a_command_is_forgotten_after_six_periods() -> None:
    commands = CommandRange()
    commands.add(CRUISE._replace(steer_rad=0.5))
    for _ in range(5):
        commands.add(NEUTRAL_INPUT)
    assert commands.distance(CRUISE._replace(steer_rad=0.5)).steer_rad == 0.0
    commands.add(NEUTRAL_INPUT)
    assert commands.distance(CRUISE._replace(steer_rad=0.5)).steer_rad == 0.5


def test_a_wheel_that_is_known_to_be_late_is_compared_with_older_commands() -> None:
    commands = CommandRange()
    commands.add(CRUISE)
    for _ in range(MEMORY_TICKS + 3):
        commands.add(NEUTRAL_INPUT)
    assert commands.distance(CRUISE, late_ticks=3) == pytest.approx((0.2, 0.0, 0.1))
    assert commands.distance(CRUISE, late_ticks=4) == pytest.approx((0.2, 0.0, 0.0))
