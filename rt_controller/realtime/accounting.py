"""How long everything took: every tick counted, the last ones kept, the worst one explained."""

from typing import NamedTuple

import numpy as np

from rt_controller.contract.bundle import Array
from rt_controller.realtime.histogram import Histogram, Percentiles
from rt_controller.realtime.lateness import Cause


class TickTimes(NamedTuple):
    """What is kept of one tick."""

    wake_us: float
    """from the scheduled instant to the loop running"""
    listen_us: float
    """before the tick: reading the frames that had come"""
    hear_us: float
    """from the loop running until all frames are read and judged"""
    plan_us: float
    """lifting, building what depends on the state, and solving"""
    qp_us: float
    """the solver's part of it"""
    answer_us: float
    """from there to the frames handed to the bus"""
    step_us: float
    """hearing, planning and answering together"""
    cpu_us: float
    """what of it was computing: the rest went to others, under the system or beneath it"""
    whole_us: float
    """listening and the step: everything between frames that come and frames that go"""
    prepare_us: float
    """before the tick: building the QP, and rehearsing; without listening"""
    qp_iterations: float
    """0 where nothing was solved"""


OF_SOLVES = frozenset({"plan_us", "qp_us", "qp_iterations"})
"""counted only for the ticks that solved a QP"""


class Worst(NamedTuple):
    """The tick whose frames left last after their instant."""

    tick: int
    """its number, counted from zero"""
    late_us: float
    cause: Cause


class DeadlineAccount:
    """Percentiles and counts over all ticks, and the times of the last `capacity` ones.

    A tick misses its deadline when its frames leave later than `deadline_ns` after the instant it
    was scheduled for. Skipped ticks are counted apart: they sent nothing at all.
    """

    def __init__(self, capacity: int, deadline_ns: int) -> None:
        self._times = np.zeros((capacity, len(TickTimes._fields)))
        self._histograms = [Histogram() for _ in TickTimes._fields]
        self._deadline_ns = deadline_ns
        self._latest_ns = -1
        self.ticks = 0
        self.deadline_misses = 0
        self.skipped_ticks = 0
        self.missed_last = False
        self.misses_by_cause = dict.fromkeys(Cause, 0)
        self.worst: Worst | None = None

    def record(self, times: TickTimes, skipped: int, done_after_ns: int) -> bool:
        """Account for one tick, after its frames have left; whether its cause is to be told.

        `done_after_ns` is when that was, after the scheduled instant and on the loop's own clock:
        simulated time knows no lateness.
        """
        self._times[self.ticks % self._times.shape[0]] = times
        for field, value, histogram in zip(TickTimes._fields, times, self._histograms, strict=True):
            if times.qp_iterations > 0.0 or field not in OF_SOLVES:
                histogram.add(value)
        self.ticks += 1
        self.skipped_ticks += skipped
        self.missed_last = done_after_ns > self._deadline_ns
        self.deadline_misses += self.missed_last
        is_worst = done_after_ns > self._latest_ns
        if is_worst:
            self._latest_ns = done_after_ns
        return is_worst or self.missed_last

    def explain(self, cause: Cause) -> None:
        """Why the tick recorded last was what it was."""
        if self.missed_last:
            self.misses_by_cause[cause] += 1
        late_us = self._latest_ns / 1e3
        if self.worst is None or late_us > self.worst.late_us:
            self.worst = Worst(self.ticks - 1, late_us, cause)

    def percentiles(self, field: str) -> Percentiles:
        """Of one field of `TickTimes`, over all ticks."""
        return self._histograms[TickTimes._fields.index(field)].percentiles()

    def last(self) -> Array:
        """Times of the last ticks, oldest first; columns as `TickTimes`."""
        kept = self._times.shape[0]
        if self.ticks <= kept:
            return self._times[: self.ticks]
        return np.roll(self._times, -(self.ticks % kept), axis=0)
