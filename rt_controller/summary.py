"""What a run amounts to: for people a table, for programs JSON with the same figures."""

from math import degrees
from typing import Any

from rich.table import Table

from rt_controller.loop import RunRecord
from rt_controller.realtime.accounting import TickTimes
from rt_controller.realtime.histogram import Percentiles
from rt_controller.session import ControllerSession


def to_json(session: ControllerSession) -> dict[str, Any]:
    """The summary with units in its keys; angles in rad, times in microseconds."""
    record, deadlines = session.record, session.record.deadlines
    return {
        **record.tracking.errors()._asdict(),
        "ticks": deadlines.ticks,
        "deadline_misses": deadlines.deadline_misses,
        "skipped_ticks": deadlines.skipped_ticks,
        "final_mode": record.outcome.mode.name,
        "ending": record.ending.name,
        "stop_cause": record.outcome.cause.name,
        "scheduler": session.guarantees.scheduler,
        "memory_locked": session.guarantees.process.memory_locked,
        "model": session.model,
        "misses_by_cause": {cause.name: n for cause, n in deadlines.misses_by_cause.items() if n},
        "worst_tick": None
        if deadlines.worst is None
        else {**deadlines.worst._asdict(), "cause": deadlines.worst.cause.name},
        **{field: deadlines.percentiles(field)._asdict() for field in TickTimes._fields},
        "frames_received": session.inbox.counts._asdict(),
        "frames_sent": session.outbox.sent,
        "send_failures": session.outbox.send_failures,
        "log_frames_dropped": 0 if session.recorder is None else session.recorder.dropped,
    }


def to_table(session: ControllerSession) -> Table:
    """The same figures for a terminal."""
    record, deadlines = session.record, session.record.deadlines
    errors = record.tracking.errors()
    table = Table(
        title=f"{session.model}: {record.ending.value}", title_justify="left", show_header=False
    )
    table.add_row(
        "lateral deviation e_y", f"RMS {errors.ey_rms_m:.3f} m, peak {errors.ey_peak_m:.3f} m"
    )
    table.add_row(
        "heading error e_psi",
        f"RMS {degrees(errors.epsi_rms_rad):.2f} deg, peak {degrees(errors.epsi_peak_rad):.2f} deg",
    )
    table.add_row(
        "speed error", f"RMS {errors.vx_rms_mps:.3f} m/s, peak {errors.vx_peak_mps:.3f} m/s"
    )
    table.add_row(
        "ticks",
        f"{deadlines.ticks}, {deadlines.deadline_misses} missed their deadline, "
        f"{deadlines.skipped_ticks} skipped",
    )
    table.add_row("step, tick to frames out", _line(deadlines.percentiles("step_us"), "us"))
    table.add_row("with reading ahead of it", _line(deadlines.percentiles("whole_us"), "us"))
    if deadlines.worst is not None:
        worst = deadlines.worst
        table.add_row(
            "worst tick",
            f"{worst.tick}, answered after {worst.late_us:.0f} us: {worst.cause.value}",
        )
    table.add_row("wake-up lateness", _line(deadlines.percentiles("wake_us"), "us"))
    table.add_row("QP solve", _line(deadlines.percentiles("qp_us"), "us"))
    table.add_row("QP iterations", _line(deadlines.percentiles("qp_iterations"), ""))
    table.add_row("frames", _frames(session))
    table.add_row("final mode", record.outcome.mode.name)
    table.add_row("held", session.guarantees.sentence())
    return table


def _frames(session: ControllerSession) -> str:
    counts = session.inbox.counts
    dropped = counts.crc_errors + counts.repeated + counts.out_of_range
    return (
        f"{session.outbox.sent} sent, {session.outbox.send_failures} not taken by the bus; "
        f"{dropped} received ones dropped, {counts.lost} lost"
    )


def _line(p: Percentiles, unit: str) -> str:
    return f"p50 {p.p50:.0f}, p99 {p.p99:.0f}, p99.9 {p.p999:.0f}, max {p.max:.0f} {unit}".rstrip()


def live_line(record: RunRecord) -> str:
    """One line about the present."""
    outcome, deadlines = record.outcome, record.deadlines
    if deadlines.ticks == 0:
        return "waiting for the vehicle"
    state, path = outcome.state, outcome.path
    where = (
        " " * 29
        if state is None or path is None
        else f"{state.state.vx_mps * 3.6:5.1f} km/h  e_y {state.state.ey_m - path.c0_m:+.3f} m  "
    )
    return (
        f"{deadlines.ticks:6d}  {outcome.mode.name:9s}  {where}"
        f"wheel {degrees(outcome.control.steer_rad):+5.1f} deg  "
        f"missed {deadlines.deadline_misses}"
    )
