"""How often a duration came, in memory that does not depend on how long one counts."""

from math import ceil, log
from typing import NamedTuple

import numpy as np

LEAST = 0.1
MOST = 1e9
WIDTH = 1.01
"""of a bucket: its upper edge over its lower one"""
_PER_E_FOLD = 1.0 / log(WIDTH)


class Percentiles(NamedTuple):
    """Of one quantity over the run; zeros if nothing was recorded."""

    p50: float
    p99: float
    p999: float
    max: float
    mean: float


class Histogram:
    """Counts in buckets one per cent wide, and the largest value that came in each.

    A percentile is a value that occurred, at most 1 % above the exact one; the maximum is exact.
    Values below 0.1 share the first bucket.
    """

    def __init__(self) -> None:
        buckets = ceil(log(MOST / LEAST) * _PER_E_FOLD) + 2
        self._counts = np.zeros(buckets, dtype=np.int64)
        self._largest = np.zeros(buckets)
        self._total = 0.0

    def add(self, value: float) -> None:
        """Count one value; not a number counts as infinite."""
        if value <= LEAST:
            bucket = 0
        elif value < MOST:
            bucket = 1 + int(log(value / LEAST) * _PER_E_FOLD)
        else:
            bucket = len(self._counts) - 1
        self._counts[bucket] += 1
        self._total += value
        if not value <= self._largest[bucket]:
            self._largest[bucket] = value

    def percentiles(self) -> Percentiles:
        """Median, p99, p99.9, maximum and mean."""
        upto = np.cumsum(self._counts)
        total = int(upto[-1])
        if total == 0:
            return Percentiles(0.0, 0.0, 0.0, 0.0, 0.0)
        # The value with at least so many in a thousand of all at or below it.
        ranks = [-(-total * per_mille // 1000) for per_mille in (500, 990, 999, 1000)]
        buckets = np.searchsorted(upto, ranks)
        p50, p99, p999, most = self._largest[buckets].tolist()
        return Percentiles(p50, p99, p999, most, self._total / total)
