"""The record of one tick: how long each of its stages took."""

from typing import NamedTuple


class TickTimes(NamedTuple):
    """Times of one tick in microseconds; the fields are the columns of `--ticks`."""

    wake_us: float
    """from the scheduled instant until the loop runs; skipped periods included"""
    read_ahead_us: float
    """before the tick: reading the frames that had arrived"""
    receive_us: float
    """reading the frames that arrived since then, and checking what is fresh and valid"""
    plan_us: float
    """lifting, expanding the reference, updating the QP and solving it"""
    qp_us: float
    """the solver's part of `plan_us`"""
    send_us: float
    """choosing the mode, limiting, and handing the frames to the bus"""
    step_us: float
    """receiving, planning and sending together"""
    cpu_us: float
    """the step's time on the processor; in the rest of `step_us` others ran"""
    total_us: float
    """reading ahead and the step: all work between received and sent frames"""
    preparation_us: float
    """before the tick: updating the matrices, and warming up; without reading"""
    preparation_late_us: float
    """computing time of the preparation after the scheduled instant"""
    overrun_us: float
    """how long the step before ran after the scheduled instant of this one"""
    qp_iterations: float
    """0: no QP was solved"""


SOLVE_FIELDS = frozenset({"plan_us", "qp_us", "qp_iterations"})
"""counted only for the ticks that solved a QP"""
