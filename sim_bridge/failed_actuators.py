"""The vehicle's own check of its actuators: a stuck steering wheel, a throttle that stays open."""

from enum import Enum

from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput
from rt_controller.contract.timing import COMMAND_TIMEOUT_TICKS

LARGEST_STEER_ERROR_RAD = 0.03
"""of a wheel that does not move: 1.7 deg"""
STILL_RAD = 1e-3
"""a wheel that moves by less in a period does not move"""
LEAST_CHANGE_RAD = 0.02
"""change of the command since the wheel last moved: with a constant command a wheel with an offset
does not move either"""
LARGEST_THROTTLE_ERROR = 0.05
"""by which the throttle may be open too far"""
FAILED_TICKS = COMMAND_TIMEOUT_TICKS
"""in a row, before the vehicle brakes by itself"""


class Actuator(Enum):
    """An actuator of which the vehicle detects a failure, and how it shows."""

    STEERING_WHEEL = "the steering wheel does not move"
    THROTTLE = "the throttle stays open"


class FailedActuators:
    """Compares the inputs that were applied with the commanded ones."""

    def __init__(self) -> None:
        self.failed: list[Actuator] = []
        """in the order of detection"""
        self.open_throttle = 0.0
        """by which it was open too far in the last period"""
        self._steer_rad = self._moved_at_rad = NEUTRAL_INPUT.steer_rad
        self._ticks = dict.fromkeys(Actuator, 0)
        """in a row in which each has not followed its command"""

    def note(self, commanded: ControlInput, applied: ControlInput) -> None:
        """After a period."""
        is_still = abs(applied.steer_rad - self._steer_rad) < STILL_RAD
        if not is_still:
            self._moved_at_rad = commanded.steer_rad
        is_off = (
            abs(commanded.steer_rad - applied.steer_rad) > LARGEST_STEER_ERROR_RAD
            and abs(commanded.steer_rad - self._moved_at_rad) > LEAST_CHANGE_RAD
        )
        self._steer_rad = applied.steer_rad
        self.open_throttle = max(applied.throttle - commanded.throttle, 0.0)
        is_open = self.open_throttle > LARGEST_THROTTLE_ERROR
        for actuator, deviates in (
            (Actuator.STEERING_WHEEL, is_still and is_off),
            (Actuator.THROTTLE, is_open),
        ):
            self._ticks[actuator] = self._ticks[actuator] + 1 if deviates else 0
            if self._ticks[actuator] >= FAILED_TICKS and actuator not in self.failed:
                self.failed.append(actuator)
