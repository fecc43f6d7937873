"""What was sent in the last periods, found again by counter, by age, and as a range."""

from collections import deque

from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput
from rt_controller.contract.timing import LONG_COUNTER_MODULUS

MOST_PERIODS = 32
"""that are remembered; an echo is at most a few periods late, a steering wheel twelve"""
MEMORY_PERIODS = 6
"""an actuator may be late by so many: 150 ms; by more where a longer delay is configured"""
LONGEST_MEMORY_PERIODS = 16
"""the same of a steering wheel whose delay is known"""


class SentCommands:
    """The inputs of the last periods, the newest last.

    While somebody else drives the car, they are the inputs that act on it, as far as it reports
    them.
    """

    def __init__(self, actuation_periods: int = 1) -> None:
        """`actuation_periods`: delay of all actuators that is configured."""
        self._memory = MEMORY_PERIODS + max(actuation_periods - 1, 0)
        self._inputs = deque([NEUTRAL_INPUT] * MOST_PERIODS, maxlen=MOST_PERIODS)
        self._counters: deque[int | None] = deque([None] * MOST_PERIODS, maxlen=MOST_PERIODS)
        self._counter: int | None = None

    @property
    def newest(self) -> ControlInput:
        """That of the last period."""
        return self._inputs[-1]

    def add(self, control: ControlInput, counter: int | None = None) -> None:
        """Add the input of this period, sent under this counter."""
        self._inputs.append(control)
        self._counters.append(None if counter == self._counter else counter)
        self._counter = counter  # the receiver drops a repeated one

    def last(self, periods: int) -> tuple[ControlInput, ...]:
        """The inputs of the last periods, the oldest first."""
        return tuple(self._inputs)[MOST_PERIODS - min(periods, MOST_PERIODS) :]

    def until(self, counter: int, most: int) -> list[ControlInput]:
        """The input that was sent under this counter and the ones before it, the newest first.

        At most `most`; fewer where a counter is missing.
        """
        found: list[ControlInput] = []
        for control, sent in zip(reversed(self._inputs), reversed(self._counters), strict=True):
            if len(found) == most:
                break
            if sent is not None and (counter - sent) % LONG_COUNTER_MODULUS == len(found):
                found.append(control)
        return found

    def outside(self, applied: ControlInput, late_periods: int = 0) -> ControlInput:
        """How far the applied input is outside of the range of the last periods; 0 inside.

        `late_periods`: by which the steering wheel is known to be later than usual.
        """
        wheel = min(self._memory + late_periods, LONGEST_MEMORY_PERIODS)
        inputs = self.last(wheel)
        recent = inputs[-self._memory :]
        return ControlInput(
            _outside(applied.throttle, [each.throttle for each in recent]),
            _outside(applied.brake_n, [each.brake_n for each in recent]),
            _outside(applied.steer_rad, [each.steer_rad for each in inputs]),
        )


def _outside(value: float, commands: list[float]) -> float:
    return max(min(commands) - value, value - max(commands), 0.0)
