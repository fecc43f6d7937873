"""Ticks of several drives, counted as one."""

import numpy as np
import pytest

from benchmarks.cadence.pool import Pool, Ticks
from rt_controller.realtime.accounting import TickTimes

FIELDS = ("tick", *TickTimes._fields)


def ticks(steps_us: list[float], qp_iterations: float = 1.0) -> Ticks:
    found = np.zeros(len(steps_us), dtype=[(name, float) for name in FIELDS])
    found["step_us"] = found["qp_us"] = steps_us
    found["qp_iterations"] = qp_iterations
    return found


def summary(ending: str, misses: int, late_us: float) -> dict[str, object]:
    return {
        "model": "made",
        "scheduler": "SCHED_FIFO 50",
        "memory_locked": True,
        "ending": ending,
        "deadline_misses": misses,
        "skipped_ticks": 2 * misses,
        "worst_tick": {"tick": 3, "late_us": late_us, "cause": "HOST"},
    }


def test_figures_are_of_all_ticks_of_all_drives() -> None:
    pool = Pool()
    pool.add(summary("SAFE_STOPPED", 1, 90_000.0), ticks([100.0] * 30))
    pool.add(summary("MISSION_OVER", 2, 800.0), ticks([400.0]))
    pool.add(summary("MISSION_OVER", 0, 700.0), ticks([900.0] * 20, qp_iterations=0.0))
    found = pool.figures()
    assert (found["ticks"], found["drives"], found["safe_stops"]) == (51, 3, 1)
    assert (found["deadline_misses"], found["skipped_ticks"]) == (3, 6)
    assert found["worst_tick"]["late_us"] == 90_000.0
    assert found["step_us"]["p50"] == pytest.approx(100.0, rel=0.01)
    assert found["step_us"]["max"] == 900.0
    assert found["step_us"]["mean"] == pytest.approx((30 * 100 + 400 + 20 * 900) / 51)
    assert found["qp_us"]["max"] == 400.0  # the last drive solved nothing
