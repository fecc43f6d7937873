"""What a run amounts to: for people a table, for programs JSON with the same figures."""

from dataclasses import asdict
from math import degrees
from typing import Any

from rich.table import Table

from rt_controller.loop import RunRecord
from rt_controller.realtime.accounting import DeadlineAccount, Percentiles
from rt_controller.realtime.tick_times import TickTimes
from rt_controller.session import ControllerSession


def to_json(session: ControllerSession) -> dict[str, Any]:
    """The summary with units in its keys; angles in rad, times in microseconds."""
    record, deadlines = session.record, session.record.deadlines
    return {
        **record.tracking.errors()._asdict(),
        "ticks": deadlines.ticks,
        "deadline_misses": deadlines.deadline_misses,
        "skipped_ticks": deadlines.skipped_ticks,
        "final_mode": record.result.mode.name,
        "ending": record.ending.name,
        "stop_cause": record.result.cause.name,
        "scheduler": session.guarantees.scheduler,
        "memory_locked": session.guarantees.process.memory_locked,
        "model": session.model,
        "misses_by_cause": {cause.name: n for cause, n in deadlines.misses_by_cause.items() if n},
        "worst_tick": None
        if deadlines.worst is None
        else {**deadlines.worst._asdict(), "cause": deadlines.worst.cause.name},
        **{field: deadlines.percentiles(field)._asdict() for field in TickTimes._fields},
        "frames_received": asdict(session.inbox.counts),
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
    table.add_row("control step", _line(deadlines.percentiles("step_us"), "us"))
    table.add_row("step and reading ahead", _line(deadlines.percentiles("total_us"), "us"))
    if deadlines.worst is not None:
        worst = deadlines.worst
        table.add_row(
            "worst tick",
            f"{worst.tick}, sent after {worst.late_us:.0f} us: {worst.cause.value}",
        )
    table.add_row("wake-up lateness", _line(deadlines.percentiles("wake_us"), "us"))
    table.add_row("QP solve", _line(deadlines.percentiles("qp_us"), "us"))
    table.add_row("QP iterations", _line(deadlines.percentiles("qp_iterations"), ""))
    table.add_row("frames", _frames(session))
    table.add_row("final mode", record.result.mode.name)
    table.add_row("real-time settings", session.guarantees.sentence())
    return table


def why_late(deadlines: DeadlineAccount) -> str:
    """What made ticks miss their deadline, the most frequent cause first."""
    causes = sorted(deadlines.misses_by_cause.items(), key=lambda item: -item[1])
    listed = ", ".join(f"{count} times {cause.value}" for cause, count in causes if count)
    missed = f"{deadlines.deadline_misses} of {deadlines.ticks} ticks missed their deadline"
    return f"{listed}: {missed}" if listed else missed


def _frames(session: ControllerSession) -> str:
    counts = session.inbox.counts
    dropped = counts.crc_errors + counts.repeated + counts.out_of_range
    return (
        f"{session.outbox.sent} sent, {session.outbox.send_failures} send errors; "
        f"{dropped} received ones dropped, {counts.lost} lost"
    )


def _line(p: Percentiles, unit: str) -> str:
    return f"p50 {p.p50:.0f}, p99 {p.p99:.0f}, p99.9 {p.p999:.0f}, max {p.max:.0f} {unit}".rstrip()


def live_line(record: RunRecord) -> str:
    """One line about the present."""
    result, deadlines = record.result, record.deadlines
    if deadlines.ticks == 0:
        return "waiting for the vehicle"
    state, path = result.state, result.path
    where = (
        " " * 29
        if state is None or path is None
        else f"{state.state.vx_mps * 3.6:5.1f} km/h  e_y {state.state.ey_m - path.c0_m:+.3f} m  "
    )
    return (
        f"{deadlines.ticks:6d}  {result.mode.name:9s}  {where}"
        f"wheel {degrees(result.control.steer_rad):+5.1f} deg  "
        f"missed {deadlines.deadline_misses}"
    )
