"""Comparison of the actuator feedback with the commands."""

from collections import deque
from collections.abc import Sequence

from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput

MEMORY_TICKS = 6
"""an actuator may be late by so many periods: 150 ms"""
LONGEST_MEMORY_TICKS = 16
"""the same of a steering wheel whose delay is known"""


class CommandRange:
    """Range of the commands of the last 150 ms, in which the feedback must lie."""

    def __init__(self) -> None:
        self._commands = tuple(
            deque([value] * ticks, maxlen=ticks)
            for value, ticks in zip(
                NEUTRAL_INPUT, (MEMORY_TICKS, MEMORY_TICKS, LONGEST_MEMORY_TICKS), strict=True
            )
        )
        """by input"""

    def add(self, command: ControlInput) -> None:
        """Add the command of this tick."""
        for values, value in zip(self._commands, command, strict=True):
            values.append(value)

    def distance(self, applied: ControlInput, late_ticks: int = 0) -> ControlInput:
        """How far the applied input is outside of the range, input by input; 0 inside.

        `late_ticks`: by which the steering wheel is known to be later than usual.
        """
        throttle, brake_n, steer_rad = self._commands
        of_wheel = tuple(steer_rad)[-MEMORY_TICKS - late_ticks :]
        return ControlInput(
            _outside(applied.throttle, throttle),
            _outside(applied.brake_n, brake_n),
            _outside(applied.steer_rad, of_wheel),
        )


def _outside(value: float, commands: Sequence[float]) -> float:
    return max(min(commands) - value, value - max(commands), 0.0)
