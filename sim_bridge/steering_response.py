"""Identification of a steering actuator with an offset, a wrong gain or a reversed direction.

The vehicle inverts the identified response in its commands, so that the car follows its path also
with such an actuator, as in the stop that the controller begins. This does not help if the wheel is
stuck.
"""

from collections import deque
from itertools import pairwise

from rt_controller.contract.limits import INPUT_LIMITS

SAMPLES = 3
"""periods that the response is fitted to; fewer than those after which a still wheel is stuck"""
LEAST_CHANGE_RAD = 0.02
"""of the command within the samples; below it the factor keeps its value"""
LARGEST_RESIDUAL_RAD = 0.02
"""of the samples from the fit; beyond it the response is not identified"""
LONGEST_LAG = 20
"""periods that a wheel may be late; the command of a wheel that is only late is not changed"""
LARGEST_LAG_ERROR_RAD = 0.01
LARGEST_RATE_SPREAD_RAD = 2e-4
"""of the changes of a wheel that turns at its largest rate towards a command that is ahead"""
SLOW_TICKS = 40
"""for which such a wheel counts as slow: a second, in which the car returns to its path"""
LEAST_FACTOR, LARGEST_FACTOR = 0.2, 3.0
LEAST_ERROR_RAD = 0.03
"""a smaller error is not corrected: 1.7 deg"""


class SteeringResponse:
    """Offset and factor from the commanded to the applied wheel angle."""

    def __init__(self) -> None:
        self.is_correcting = False
        """an error was identified; from then on the commands are corrected"""
        self.is_identified = False
        """factor and offset explain the last samples"""
        self._slow_ticks = 0
        self._samples: deque[tuple[float, float]] = deque(maxlen=SAMPLES)
        self._commanded: deque[float] = deque(maxlen=LONGEST_LAG + SAMPLES)
        self._factor = 1.0
        self._offset_rad = 0.0
        self._off_ticks = 0
        self._has_probed = False

    @property
    def is_slow(self) -> bool:
        """True if the wheel turned steadily, and behind its command, within the last second."""
        return self._slow_ticks > 0

    def note(self, commanded_rad: float, applied_rad: float) -> None:
        """After a period."""
        self._samples.append((commanded_rad, applied_rad))
        self._commanded.append(commanded_rad)
        is_off = abs(applied_rad - commanded_rad) > LEAST_ERROR_RAD
        self._off_ticks = self._off_ticks + 1 if is_off else 0
        is_full = len(self._samples) == SAMPLES
        is_late = is_full and self._is_late()
        is_slow = is_full and not is_late and self._turns_steadily()
        self._slow_ticks = SLOW_TICKS if is_slow else max(self._slow_ticks - 1, 0)
        self.is_identified = is_full and not (is_late or is_slow) and self._fit()
        if self.is_identified and self._off_ticks >= SAMPLES:
            self.is_correcting = True

    def command_for(self, wanted_rad: float) -> float:
        """The command with which the wheel reaches `wanted_rad`, within the bounds.

        The first time that the bounds do not allow it, the command is 0: with a constant command an
        offset cannot be distinguished from a reversed wheel.
        """
        if not self.is_correcting:
            return wanted_rad
        commanded_rad = (wanted_rad - self._offset_rad) / self._factor
        lower, upper = INPUT_LIMITS.lower.steer_rad, INPUT_LIMITS.upper.steer_rad
        if not (lower <= commanded_rad <= upper or self._has_probed):
            self._has_probed = True
            return 0.0
        return min(max(commanded_rad, lower), upper)

    def _turns_steadily(self) -> bool:
        """True if the wheel turns steadily towards a command that is ahead of it."""
        applied = [each[1] for each in self._samples]
        changes = [after - before for before, after in pairwise(applied)]
        is_steady = max(changes) - min(changes) < LARGEST_RATE_SPREAD_RAD
        commanded_rad, applied_rad = self._samples[-1]
        return is_steady and (commanded_rad - applied_rad) * changes[-1] > 0.0

    def _is_late(self) -> bool:
        """True if the wheel follows the commands of some periods before."""
        commanded, applied = list(self._commanded), [each[1] for each in self._samples]
        return any(
            max(
                abs(before - now)
                for before, now in zip(commanded[-SAMPLES - lag : -lag], applied, strict=True)
            )
            < LARGEST_LAG_ERROR_RAD
            for lag in range(1, len(commanded) - SAMPLES + 1)
        )

    def _fit(self) -> bool:
        """Least squares over the samples; False if a factor and an offset do not explain them."""
        commanded, applied = zip(*self._samples, strict=True)
        mean_commanded, mean_applied = sum(commanded) / SAMPLES, sum(applied) / SAMPLES
        factor = self._factor
        if max(commanded) - min(commanded) > LEAST_CHANGE_RAD:
            spread = sum((a - mean_commanded) ** 2 for a in commanded)
            shared = sum(
                (a - mean_commanded) * (b - mean_applied)
                for a, b in zip(commanded, applied, strict=True)
            )
            factor = shared / spread
        if not LEAST_FACTOR <= abs(factor) <= LARGEST_FACTOR:
            return False
        residuals = (
            abs(b - mean_applied - factor * (a - mean_commanded))
            for a, b in zip(commanded, applied, strict=True)
        )
        if max(residuals) > LARGEST_RESIDUAL_RAD:
            return False
        self._factor = factor
        self._offset_rad = applied[-1] - factor * commanded[-1]
        return True
