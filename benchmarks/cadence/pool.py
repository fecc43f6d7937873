"""Ticks of several drives counted as one: a machine that stands still ends a drive, not a count."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rt_controller.realtime.accounting import OF_SOLVES
from rt_controller.realtime.histogram import Histogram

Ticks = NDArray[np.void]
"""(ticks,), a record of `TickTimes` and of the tick's number"""


class Pool:
    """Summaries and times of drives under the same settings."""

    def __init__(self) -> None:
        self._summaries: list[dict[str, Any]] = []
        self._ticks: list[Ticks] = []

    @property
    def n_ticks(self) -> int:
        return sum(len(ticks) for ticks in self._ticks)

    def add(self, summary: dict[str, Any], ticks: Ticks) -> None:
        """One drive."""
        self._summaries.append(summary)
        self._ticks.append(ticks)

    def figures(self) -> dict[str, Any]:
        """Of all ticks: percentiles of each time, counts, and the worst tick of any drive."""
        ticks = np.concatenate(self._ticks)
        fields = [name for name in ticks.dtype.names or () if name != "tick"]
        return {
            "model": self._summaries[0]["model"],
            "scheduler": self._summaries[0]["scheduler"],
            "memory_locked": self._summaries[0]["memory_locked"],
            "ticks": len(ticks),
            "drives": len(self._summaries),
            "safe_stops": sum(found["ending"] == "SAFE_STOPPED" for found in self._summaries),
            "deadline_misses": sum(found["deadline_misses"] for found in self._summaries),
            "skipped_ticks": sum(found["skipped_ticks"] for found in self._summaries),
            "worst_tick": max(
                (found["worst_tick"] for found in self._summaries),
                key=lambda worst: float(worst["late_us"]),
            ),
            **{field: _percentiles(ticks, field) for field in fields},
        }


def _percentiles(ticks: Ticks, field: str) -> dict[str, float]:
    histogram = Histogram()
    counted = ticks[ticks["qp_iterations"] > 0.0] if field in OF_SOLVES else ticks
    for value in counted[field].tolist():
        histogram.add(value)
    return histogram.percentiles()._asdict()
