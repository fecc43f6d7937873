"""Statistics of all ticks: percentiles, missed deadlines, the worst tick and the last times."""

from math import ceil, log
from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.realtime.kernel_counters import LateCause
from rt_controller.realtime.tick_times import SOLVE_FIELDS, TickTimes

LOWEST = 0.1
HIGHEST = 1e9
BUCKET_RATIO = 1.01
"""upper edge of a bucket divided by its lower edge"""
_BUCKETS_PER_E_FOLD = 1.0 / log(BUCKET_RATIO)


class Percentiles(NamedTuple):
    """Percentiles of one quantity over the run; zeros if nothing was recorded."""

    p50: float
    p99: float
    p999: float
    max: float
    mean: float


class Histogram:
    """Counts of values in buckets one per cent wide, and the largest value of each bucket.

    A percentile is a value that was recorded, at most 1 % above the exact one; the maximum is
    exact. Values below `LOWEST` share the first bucket.
    """

    def __init__(self) -> None:
        buckets = ceil(log(HIGHEST / LOWEST) * _BUCKETS_PER_E_FOLD) + 2
        self._counts = np.zeros(buckets, dtype=np.int64)
        self._largest = np.zeros(buckets)
        self._total = 0.0

    def add(self, value: float) -> None:
        """Count one value."""
        if value <= LOWEST:
            bucket = 0
        elif value < HIGHEST:
            bucket = 1 + int(log(value / LOWEST) * _BUCKETS_PER_E_FOLD)
        else:
            bucket = len(self._counts) - 1
        self._counts[bucket] += 1
        self._total += value
        self._largest[bucket] = max(self._largest[bucket], value)

    def percentiles(self) -> Percentiles:
        cumulative = np.cumsum(self._counts)
        total = int(cumulative[-1])
        if total == 0:
            return Percentiles(0.0, 0.0, 0.0, 0.0, 0.0)
        # The smallest value with at least so many per mille of all values at or below it.
        ranks = [-(-total * per_mille // 1000) for per_mille in (500, 990, 999, 1000)]
        p50, p99, p999, most = self._largest[np.searchsorted(cumulative, ranks)].tolist()
        return Percentiles(p50, p99, p999, most, self._total / total)


class WorstTick(NamedTuple):
    """The tick whose frames were sent last after its scheduled instant."""

    tick: int
    """counted from zero"""
    late_us: float
    cause: LateCause


class DeadlineAccount:
    """Percentiles and counts over all ticks, and the times of the last `capacity` ticks.

    A tick misses its deadline if its frames are sent later than `deadline_ns` after its scheduled
    instant. Skipped ticks are counted separately: they sent no frames.
    """

    def __init__(self, capacity: int, deadline_ns: int) -> None:
        self._times = np.zeros((capacity, len(TickTimes._fields)))
        self._histograms = [Histogram() for _ in TickTimes._fields]
        self._deadline_ns = deadline_ns
        self.ticks = 0
        self.deadline_misses = 0
        self.skipped_ticks = 0
        self.missed_last = False
        self.misses_by_cause = dict.fromkeys(LateCause, 0)
        self.worst: WorstTick | None = None

    def record(
        self, times: TickTimes, skipped: int, sent_after_ns: int, cause: LateCause | None = None
    ) -> None:
        """Count one tick, with the reason if it was late, and the periods skipped before it.

        `sent_after_ns` is the time from the scheduled instant until the frames were sent, on the
        loop's clock: simulated time has no lateness.
        """
        self._times[self.ticks % self._times.shape[0]] = times
        for field, value, histogram in zip(TickTimes._fields, times, self._histograms, strict=True):
            if times.qp_iterations > 0.0 or field not in SOLVE_FIELDS:
                histogram.add(value)
        self.ticks += 1
        self.skipped_ticks += skipped
        self.missed_last = sent_after_ns > self._deadline_ns
        self.deadline_misses += self.missed_last
        if cause is None:
            return
        if self.missed_last:
            self.misses_by_cause[cause] += 1
        late_us = sent_after_ns / 1e3
        if self.worst is None or late_us > self.worst.late_us:
            self.worst = WorstTick(self.ticks - 1, late_us, cause)

    def percentiles(self, field: str) -> Percentiles:
        return self._histograms[TickTimes._fields.index(field)].percentiles()

    def last(self) -> Array:
        """(ticks, fields) times of the last ticks, oldest first; columns as `TickTimes`."""
        capacity = self._times.shape[0]
        if self.ticks <= capacity:
            return self._times[: self.ticks]
        return np.roll(self._times, -(self.ticks % capacity), axis=0)
