"""`FmuClock`: the communication points of an FMU against the control periods.

If a whole number of communication steps is a period, both meet at the end of every period, and the
motion is what the FMU computed. Otherwise the FMU runs on its own grid: it computes the step that
contains the end of the period, with the input that was valid at the step's start, and the motion in
between is interpolated linearly. No value of the future is used: an FMU holds its inputs over a
step, so the end of the step follows from what is known at its start.
"""

from sim_bridge.plant.library import STEP_S

_TOLERANCE = 1e-3
"""of the communication step; rounding errors of times are far smaller"""


class FmuClock:
    """Counts communication steps and periods from the start of a run."""

    def __init__(self, step_s: float) -> None:
        self.step_s = step_s
        self.period_start_s = 0.0
        self._steps = 0

    def restart(self) -> None:
        """Begin a run."""
        self.period_start_s, self._steps = 0.0, 0

    @property
    def fmu_s(self) -> float:
        """Time of the last communication point."""
        return self._steps * self.step_s

    @property
    def is_in_past(self) -> bool:
        """True if the next communication step begins before the present period."""
        return self.fmu_s < self.period_start_s - _TOLERANCE * self.step_s

    def points_in(self, dt_s: float) -> int:
        """How many points of the motion a period has: the communication steps, or milliseconds."""
        n_steps = round(dt_s / self.step_s)
        if n_steps >= 1 and abs(n_steps * self.step_s - dt_s) <= _TOLERANCE * self.step_s:
            return n_steps
        return max(1, round(dt_s / STEP_S))

    def is_before(self, time_s: float) -> bool:
        """True if the FMU has to compute another step to reach this time."""
        return self.fmu_s < time_s - _TOLERANCE * self.step_s

    def count_step(self) -> None:
        """Note that the FMU has computed a step."""
        self._steps += 1

    def share_of_step(self, time_s: float) -> float:
        """Position of a time in the last step: 0 at its start, 1 at its end."""
        behind_s = self.fmu_s - time_s
        return 1.0 if behind_s <= _TOLERANCE * self.step_s else 1.0 - behind_s / self.step_s

    def end_period(self, dt_s: float) -> None:
        """Note that a period has passed."""
        self.period_start_s += dt_s
