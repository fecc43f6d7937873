"""Figures of several drives are computed over all their ticks."""

import numpy as np
import pytest

from benchmarks.cadence.drive import CadenceRun, aggregate
from rt_controller.realtime.timing import TickTimes

FIELDS = ("tick", *TickTimes._fields)


def run(
    ending: str, misses: int, late_us: float, step_us: list[float], qp_iterations: float = 1.0
) -> CadenceRun:
    ticks = np.zeros(len(step_us), dtype=[(name, float) for name in FIELDS])
    ticks["step_us"] = ticks["qp_us"] = step_us
    ticks["qp_iterations"] = qp_iterations
    summary = {
        "model": "made",
        "scheduler": "SCHED_FIFO 50",
        "memory_locked": True,
        "ending": ending,
        "deadline_misses": misses,
        "skipped_ticks": 2 * misses,
        "worst_tick": {"tick": 3, "late_us": late_us, "cause": "HOST"},
    }
    return CadenceRun(summary, ticks)


def test_figures_are_of_all_ticks_of_all_drives() -> None:
    found = aggregate(
        [
            run("SAFE_STOPPED", 1, 90_000.0, [100.0] * 30),
            run("MISSION_OVER", 2, 800.0, [400.0]),
            run("MISSION_OVER", 0, 700.0, [900.0] * 20, qp_iterations=0.0),
        ]
    )
    assert (found["ticks"], found["drives"], found["safe_stops"]) == (51, 3, 1)
    assert (found["deadline_misses"], found["skipped_ticks"]) == (3, 6)
    assert found["worst_tick"]["late_us"] == 90_000.0
    assert found["step_us"]["p50"] == pytest.approx(100.0, rel=0.01)
    assert found["step_us"]["max"] == 900.0
    assert found["step_us"]["mean"] == pytest.approx((30 * 100 + 400 + 20 * 900) / 51)
    assert found["qp_us"]["max"] == 400.0  # the last drive solved nothing
