"""How long everything took: every tick's times in preallocated memory, percentiles at the end."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Percentiles(NamedTuple):
    """Of one quantity over the run; zeros if nothing was recorded."""

    p50: float
    p99: float
    p999: float
    max: float


class TickTimes(NamedTuple):
    """What is kept of one tick."""

    wake_us: float
    """from the scheduled instant to the loop running"""
    step_us: float
    """from there to the frames handed to the bus"""
    qp_us: float
    """the planning part of it"""
    qp_iterations: float
    """0 where nothing was solved"""


class DeadlineAccount:
    """Times of the last `capacity` ticks, and counts over all of them.

    A tick misses its deadline when its frames leave later than `deadline_ns` after the instant it
    was scheduled for. Skipped ticks are counted apart: they sent nothing at all.
    """

    def __init__(self, capacity: int, deadline_ns: int) -> None:
        self._times = np.zeros((capacity, len(TickTimes._fields)))
        self._deadline_ns = deadline_ns
        self.ticks = 0
        self.deadline_misses = 0
        self.skipped_ticks = 0
        self.missed_last = False

    def record(self, times: TickTimes, skipped: int, done_after_ns: int) -> None:
        """Account for one tick, after its frames have left.

        `done_after_ns` is when that was, after the scheduled instant and on the loop's own clock:
        simulated time knows no lateness.
        """
        self._times[self.ticks % self._times.shape[0]] = times
        self.ticks += 1
        self.skipped_ticks += skipped
        self.missed_last = done_after_ns > self._deadline_ns
        self.deadline_misses += self.missed_last

    def percentiles(self, field: str) -> Percentiles:
        """Of one field of `TickTimes`; of the QP's fields only over the ticks that solved one."""
        recorded = self._times[: min(self.ticks, self._times.shape[0])]
        column = recorded[:, TickTimes._fields.index(field)]
        if field.startswith("qp_"):
            column = column[recorded[:, TickTimes._fields.index("qp_iterations")] > 0]
        return percentiles(column)


def percentiles(values: NDArray[np.float64]) -> Percentiles:
    """Median, p99, p99.9, maximum: each a value that occurred, none interpolated."""
    if values.size == 0:
        return Percentiles(0.0, 0.0, 0.0, 0.0)
    p50, p99, p999 = np.percentile(values, [50.0, 99.0, 99.9], method="higher")
    return Percentiles(float(p50), float(p99), float(p999), float(values.max()))
