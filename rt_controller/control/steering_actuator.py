"""How the steering wheel follows its commands: how late it is, and how fast it can turn."""

from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from math import copysign, inf

from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import PathReference
from rt_controller.contract.timing import PERIOD_S

LONGEST_DELAY = 12
"""periods from an accepted command to the wheel; a longer delay is not found"""
SAMPLES = 4
"""periods in a row that a delay or a rate has to explain: 100 ms"""
LARGEST_RESIDUAL_RAD = 0.002
"""of a wheel that is only late: 0.1 deg; with more, an offset looks like a delay"""
LEAST_ERROR_RAD = 0.015
"""by which the wheel differs from the present explanation, before another one replaces it"""
LEAST_TURN_RAD = 0.01
"""of the wheel within the samples; a wheel that does not turn shows no delay: it may be stuck"""
SAME_GAIN = 0.04
"""largest difference of the gain of the angle from that of its changes, in a wheel with a wrong
gain"""
LARGEST_SPREAD_RAD = 1e-3
"""of the changes of a wheel that turns at its largest rate; with more, an offset looks like that"""
LEAST_CHANGE_RAD = 0.003
"""of such a wheel in a period: 7 deg/s; a slower one is stuck"""
LEAST_SLOW_ERROR_RAD = 0.006
"""the same of a wheel that is known to be slow"""
RECOVERY_PER_S = 0.1
"""share by which a limit of the rate is raised"""
SLOWING_MPS2, RESUMING_MPS2 = 2.5, 0.5
"""at which the wanted speed falls while the wheel turns at its largest rate, and rises after"""
AT_RATE = 0.9
"""share of the largest rate at which the wheel counts as turning at it"""
SLOWEST_MPS = 5.0
"""the wanted speed of a car with a slow wheel is not reduced further"""


class SteeringActuator:
    """Delay and largest rate of the steering wheel, from ACT_FB and the commands that were sent.

    A wheel that follows its commands as it is configured changes neither. Another delay replaces
    the present one if it explains the last samples, and the present one does not. A largest rate is
    found if no delay explains them, and the wheel turns steadily towards a command that is ahead.
    """

    def __init__(
        self, configured_periods: int, usual_radps: float = INPUT_LIMITS.rate_per_s.steer_rad
    ) -> None:
        """The shortest delay, that of a car without a fault, and the rate of its commands."""
        self._usual_radps = usual_radps
        self.delay_periods = self._configured = configured_periods
        self.rate_radps = inf
        """largest rate that the wheel shows; inf: it follows each command"""
        self._most_mps = inf
        self.angle_rad: float | None = None
        """that was reported last; None: not known"""
        self._angles_rad: deque[float] = deque(maxlen=SAMPLES)
        self._residuals_rad: deque[list[float]] = deque(maxlen=SAMPLES)

    @property
    def late_periods(self) -> int:
        """By how much the wheel is later than it is configured."""
        return self.delay_periods - self._configured

    @property
    def is_slow(self) -> bool:
        """True if a largest rate was found, below that of the commands."""
        return self.rate_radps < inf

    def note(self, commands_rad: Sequence[float] | None, angle_rad: float | None) -> None:
        """Take the angle of the last period.

        Args:
            commands_rad: `LONGEST_DELAY` + 1 commands, the last one that was accepted first; None:
                not known.
            angle_rad: as reported by ACT_FB; None: not received.
        """
        self.angle_rad = angle_rad
        if angle_rad is None or commands_rad is None:
            self._angles_rad.clear()
            self._residuals_rad.clear()
            return
        self._angles_rad.append(angle_rad)
        self._residuals_rad.append([command - angle_rad for command in commands_rad])
        is_slow = self.rate_radps < inf and self._is_slow_after_recovery()
        least_rad = LEAST_SLOW_ERROR_RAD if is_slow else LEAST_ERROR_RAD
        if len(self._angles_rad) < SAMPLES or self._error_rad(self.delay_periods) < least_rad:
            return
        delays = range(self._configured, LONGEST_DELAY + 1)
        best = min(delays, key=self._error_rad)
        if self._error_rad(best) >= LARGEST_RESIDUAL_RAD:
            self._find_rate(least_rad)
        elif max(self._angles_rad) - min(self._angles_rad) > LEAST_TURN_RAD:
            self.delay_periods = best

    def slowed(self, path: PathReference, vx_mps: float) -> PathReference:
        """The path with a wanted speed that falls while the wheel turns at its largest rate.

        Called once a period. The slower the car, the more slowly its wheel has to turn.
        """
        change_rad = AT_RATE * self.rate_radps * PERIOD_S
        is_slow = self.rate_radps < inf
        if is_slow and any(abs(b - a) > change_rad for a, b in pairwise(self._angles_rad)):
            self._most_mps = max(min(self._most_mps, vx_mps) - SLOWING_MPS2 * PERIOD_S, SLOWEST_MPS)
            if path.v_mps > self._most_mps:
                return path._replace(v_mps=self._most_mps, a_mps2=min(path.a_mps2, -SLOWING_MPS2))
        elif not is_slow:
            self._most_mps += RESUMING_MPS2 * PERIOD_S
        if path.v_mps > self._most_mps:
            return path._replace(v_mps=self._most_mps, a_mps2=min(path.a_mps2, 0.0))
        return path

    def angles_under_way(self, commands_rad: Sequence[float]) -> list[float]:
        """The angles that a slow wheel reaches in the next periods, with the commands under way."""
        angle_rad, found = self.angle_rad, []
        change_rad = self.rate_radps * PERIOD_S
        for command_rad in commands_rad:
            if angle_rad is None:
                angle_rad = command_rad
            angle_rad = min(max(command_rad, angle_rad - change_rad), angle_rad + change_rad)
            found.append(angle_rad)
        return found

    def _error_rad(self, delay: int) -> float:
        """The largest of the last samples with this delay."""
        largest_rad = 0.0
        for residuals_rad in self._residuals_rad:
            largest_rad = max(largest_rad, abs(residuals_rad[delay]))
        return largest_rad

    def _find_rate(self, least_rad: float) -> None:
        changes = [after - before for before, after in pairwise(self._angles_rad)]
        mean = sum(changes) / len(changes)
        is_steady = max(changes) - min(changes) < LARGEST_SPREAD_RAD
        residuals = [each[self.delay_periods] for each in self._residuals_rad]
        ahead = min(copysign(1.0, mean) * residual for residual in residuals[1:])
        # A wheel with another gain, or an offset, turns steadily too where its commands do.
        commanded_rad = mean + (residuals[-1] - residuals[0]) / len(changes)
        command_rad = self._angles_rad[-1] + residuals[-1]
        share = mean / commanded_rad if commanded_rad * mean > 0.0 else 0.0
        is_gain = abs(self._angles_rad[-1] - share * command_rad) < SAME_GAIN * abs(command_rad)
        is_proportional = is_gain or share > 1.0 - SAME_GAIN
        is_limited = is_steady and not is_proportional
        rate_radps = abs(mean) / PERIOD_S
        if is_limited and abs(mean) > LEAST_CHANGE_RAD and ahead > least_rad:
            self.rate_radps = rate_radps if rate_radps < AT_RATE * self._usual_radps else inf

    def _is_slow_after_recovery(self) -> bool:
        """True if the raised limit of the rate is still below that of the commands."""
        if len(self._angles_rad) > 1:
            shown_radps = abs(self._angles_rad[-1] - self._angles_rad[-2]) / PERIOD_S
            self.rate_radps = max(self.rate_radps, shown_radps)
        self.rate_radps *= 1.0 + RECOVERY_PER_S * PERIOD_S
        if self.rate_radps >= self._usual_radps:
            self.rate_radps = inf
        return self.rate_radps < inf
