"""Summary of a run: for people a verdict and a table, for programs JSON with the same figures."""

from collections.abc import Iterator
from dataclasses import asdict
from importlib.metadata import version
from math import ceil, degrees
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rt_controller.bus.log.recorder import log_to_json
from rt_controller.contract.errors import OutputError
from rt_controller.contract.faults import FAULT_SENTENCES, Fault, StopCause
from rt_controller.contract.files import atomic_write
from rt_controller.contract.timing import PERIOD_S
from rt_controller.drive.scenario import DrivenScenario, LateralError
from rt_controller.loop import Ending, RunRecord
from rt_controller.realtime.timing import DeadlineAccount, Percentiles, TickTimes
from rt_controller.report.table import Fact, Table, facts_table
from rt_controller.safety.modes import STANDING_MPS
from rt_controller.session import ControllerSession
from rt_controller.settings import OWN
from rt_controller.terminal.progress import Line
from rt_controller.terminal.stop_message import explain_braking, failed_checks

if TYPE_CHECKING:
    from rt_controller.terminal.options import RunOptions

AS_RECEIVED = ", as received"
"""of errors with states that a check refused, or that differ from those of the car"""
LARGEST_DIFFERENCE_M = 0.01
"""of the received lateral error and that of the simulated car, from resolution and delay"""
STOPPING = "stopping: braking to rest; press Ctrl-C twice more to end at once"
STILL_STOPPING = "stopping: braking to rest; press Ctrl-C once more to end at once"
NOT_ENGAGED = (
    f"{StopCause.NOT_ENGAGED.value}: expected it within 1 m of the path and 0.15 rad of its "
    f"heading, and a path that can be driven; found otherwise for 5 s. Start closer to the path."
)


def driven_to_json(options: "RunOptions", scenario: DrivenScenario | None) -> dict[str, Any]:
    """What was driven; null where only the other end of the bus has it."""
    is_own = scenario is not None and options.plant == OWN
    return {
        "version": version("rt-controller"),
        "bus": options.bus,
        "channel": options.channel,
        "pace": options.pace,
        "scenario": scenario and scenario.name,
        "scenario_file": scenario and options.scenario,
        "plant": scenario and options.plant,
        "car": scenario.plant if scenario is not None and is_own else None,
        "friction": scenario and scenario.friction,
    }


def to_json(session: ControllerSession, car: LateralError | None = None) -> dict[str, Any]:
    """The summary with units in its keys; angles in rad, times in microseconds.

    `car` is the true lateral error, of a simulated car in this process.
    """
    condition = session.inbox.condition
    return {
        **record_to_json(session.record),
        "car_ey_rms_m": car and car.rms_m,
        "car_ey_peak_m": car and car.peak_m,
        "stop_checks": [each._asdict() for each in failed_checks(session)],
        "scheduler": session.guarantees.scheduler,
        "memory_locked": session.guarantees.memory_locked,
        "model": session.model,
        "controller": session.planner.name,
        "frames_received": asdict(session.inbox.counts),
        "frames_sent": session.outbox.sent,
        "send_failures": session.outbox.send_failures,
        **log_to_json(session.recorder),
        "send_queue_full": session.outbox.queue_full,
        "bus_condition": {**asdict(session.inbox.condition), "state": condition.state.name},
    }


def record_to_json(record: RunRecord) -> dict[str, Any]:
    """The part of the summary that a recorded drive has too."""
    deadlines = record.deadlines
    return {
        **record.trace.errors()._asdict(),
        "errors_as_received": has_rejected_states(record),
        "at_limit_s": record.trace.at_limit_s()._asdict(),
        "ticks": deadlines.ticks,
        "deadline_misses": deadlines.deadline_misses,
        "skipped_ticks": deadlines.skipped_ticks,
        "final_mode": record.result.mode.name,
        "ending": record.ending.name,
        "stop_cause": record.result.cause.name,
        "stop_tick": record.stop_tick,
        "stop_s": record.stop_s,
        "misses_by_cause": {cause.name: n for cause, n in deadlines.misses_by_cause.items() if n},
        "worst_tick": None
        if deadlines.worst is None
        else {**deadlines.worst._asdict(), "cause": deadlines.worst.cause.name},
        **{field: deadlines.percentiles(field)._asdict() for field in TickTimes._fields},
        "ticks_by_fault": {fault.name: n for fault, n in record.ticks_by_fault.items() if n},
        "first_s_by_fault": {fault.name: s for fault, s in record.first_s_by_fault.items()},
        "outside_training": record.excess and record.excess.text,
    }


def verdict(record: RunRecord, car: LateralError | None = None, braking: str = "") -> str:
    """How the drive went, in one sentence; `car` and `braking` are those of `to_table`."""
    deadlines = record.deadlines
    speed_mps = record.result.estimate.speed_mps
    if deadlines.ticks == 0:
        return "Nothing was driven: the drive ended before the first tick."
    if record.ending is Ending.ENDED_AT_ONCE:
        return f"The drive was {explain_end_at_once(speed_mps)}."
    if record.ending is Ending.REFUSED:
        return f"The car was not taken over: {StopCause.NOT_ENGAGED.value}."
    if record.ending is Ending.SAFE_STOPPED:
        after = "" if record.stop_s is None else f" after {record.stop_s:.1f} s"
        return f"The drive ended in a safe stop{after}: {record.result.cause.value}."
    errors = record.trace.errors()
    if not any(errors):
        return f"The car was not driven: {record.ending.value}."
    peak_m = errors.ey_peak_m if car is None else car.peak_m
    within = f"{peak_m:.1f} m" if peak_m >= 1.0 else f"{max(ceil(100 * peak_m), 1)} cm"
    was = "step was" if deadlines.deadline_misses == 1 else "steps were"
    late = f"{deadlines.deadline_misses} {was} late"
    is_cut = record.ending is Ending.LOG_ENDED
    text = f"{record.ending.value.capitalize()}; until then the car" if is_cut else "The car"
    text += f" followed its path within {within}"
    if car is None and has_rejected_states(record):
        text += AS_RECEIVED
    if record.ticks_by_fault[Fault.SPEED_NOT_FOLLOWED]:
        text += f", but not its speed (up to {errors.vx_peak_mps:.1f} m/s off)"
    if outside := _outside(record):
        text += f"; {outside}"
    text += "; "
    text += late if deadlines.deadline_misses else "no step was late"
    if record.ending is Ending.STOPPED:
        text += "; it was stopped on request"
    elif not is_cut and speed_mps is not None and speed_mps > STANDING_MPS:
        text += f"; the drive ended at {speed_mps * 3.6:.0f} km/h, as if a driver took over"
    return f"{text}; {explain_braking(braking)}." if braking else f"{text}."


def _outside(record: RunRecord) -> str:
    """For how long the motion was outside of the training of the model; empty if it was not."""
    time_s, excess = PERIOD_S * record.ticks_by_fault[Fault.OUTSIDE_TRAINING], record.excess
    if excess is None:
        return ""
    return f"{time_s:.1f} s outside of what the model was trained with: {excess.text}"


def fault_sentences(record: RunRecord) -> list[str]:
    """A sentence for each fault that occurred, the first one first, with its ticks and time."""
    counts = record.ticks_by_fault
    return [
        f"{FAULT_SENTENCES[fault]} ({fault.name}, {counts[fault]} "
        f"{'ticks, first' if counts[fault] > 1 else 'tick,'} at {first_s:.3f} s)"
        for fault, first_s in record.first_s_by_fault.items()
    ]


def explain_end_at_once(speed_mps: float | None) -> str:
    """How a third request ended the drive."""
    at = "an unknown speed" if speed_mps is None else f"{3.6 * speed_mps:.0f} km/h"
    return f"ended at once at {at}: the last frame was a safe command, the vehicle brakes the car"


def to_table(
    session: ControllerSession,
    car: LateralError | None = None,
    braking: str = "",
    is_verbose: bool = False,
) -> Table:
    """The figures for a terminal.

    Args:
        session: that has ended.
        car: true lateral error, of a simulated car in this process.
        braking: why the vehicle brakes by itself; empty if it does not.
        is_verbose: with times, frames and real-time settings.
    """
    record, deadlines = session.record, session.record.deadlines
    e, worst, counts = record.trace.errors(), deadlines.worst, session.inbox.counts
    dropped = counts.crc_errors + counts.repeated + counts.out_of_range
    is_rejected = has_rejected_states(record)
    received = AS_RECEIVED if is_rejected else ""
    told = LateralError(e.ey_rms_m, e.ey_peak_m)
    facts = {} if car is None else {"lateral error": car.text}
    if car is None or is_rejected or _is_far(car, told):
        facts[f"lateral error{received if car is None else AS_RECEIVED}"] = told.text
    facts |= {
        f"heading error{received}": f"RMS {degrees(e.epsi_rms_rad):.2f} deg, "
        f"peak {degrees(e.epsi_peak_rad):.2f} deg",
        f"speed error{received}": f"RMS {e.vx_rms_mps:.3f} m/s, peak {e.vx_peak_mps:.3f} m/s",
        "inputs at their limit": _limited(record),
        "model": _outside(record),
        "ticks": f"{deadlines.ticks}, {deadlines.deadline_misses} missed their deadline, "
        f"{deadlines.skipped_ticks} skipped",
    }
    if is_verbose:
        for name, field, unit in (
            ("control step", "step_us", " us"),
            ("step and reading ahead", "total_us", " us"),
            ("wake-up lateness", "wake_us", " us"),
            ("QP solve", "qp_us", " us"),
            ("QP iterations", "qp_iterations", ""),
        ):
            facts[name] = _line(deadlines.percentiles(field)) + unit
        if worst is not None:
            late = f"{worst.tick}, sent after {worst.late_us:.0f} us: {worst.cause.value}"
            facts["worst tick"] = late
        facts["frames"] = (
            f"{session.outbox.sent} sent, {session.outbox.send_failures} send errors; "
            f"{dropped} received ones dropped, {counts.counter_gap_frames} missing (counter gaps)"
        )
        facts["real-time settings"] = (
            "none, in simulated time" if session.is_lockstep else session.guarantees.sentence()
        )
    facts |= {
        "bus": _bus_line(session),
        "final mode": record.result.mode.name,
        "safe stop": ""
        if record.stop_s is None
        else f"from {record.stop_s:.3f} s on (tick {record.stop_tick})",
        "vehicle brakes by itself": braking,
        "log": _log_line(session),
    }
    return facts_table((Fact(*fact) for fact in facts.items() if fact[1]), session.planner.name)


def _log_line(session: ControllerSession) -> str:
    recorder = session.recorder
    if recorder is None:
        return ""
    lost = f": {recorder.last_failure}" if recorder.last_failure else ""
    return f"{recorder.path}, {recorder.written} frames, {recorder.dropped} dropped{lost}"


def has_rejected_states(record: RunRecord) -> bool:
    """True if a check refused states that were received; they are part of the errors."""
    return record.ticks_by_fault[Fault.STATE_IMPLAUSIBLE] > 0


def _is_far(car: LateralError, received: LateralError) -> bool:
    """True if received states told another lateral error than that of the car."""
    return any(abs(a - b) > LARGEST_DIFFERENCE_M for a, b in zip(car, received, strict=True))


def _bus_line(session: ControllerSession) -> str:
    """What kernel and CAN controller reported; empty if nothing."""
    condition, counts = session.inbox.condition, session.inbox.counts
    parts = (
        (condition.error_frames, "error frames"),
        (condition.bus_off, "times bus-off"),
        (condition.restarts, "times restarted"),
        (condition.link_downs, "times down"),
        (condition.controller_overflows, "overflows of the CAN controller"),
        (counts.overflowed, "frames lost in the receive buffer"),
        (session.outbox.queue_full, "frames refused by a full queue"),
    )
    listed = ", ".join(f"{count} {words}" for count, words in parts if count)
    return f"{listed}; at last {condition.state.value}" if listed else ""


def _limited(record: RunRecord) -> str:
    """Which inputs were at their limit, and for how long."""
    upper = record.result.limits.upper
    names = (
        f"throttle ({upper.throttle:g})",
        f"brake ({upper.brake_n:g} N)",
        "steering wheel (that of its speed)",
    )
    times = zip(names, record.trace.at_limit_s(), strict=True)
    return ", ".join(f"{name} for {time_s:.1f} s" for name, time_s in times if time_s > 0.0)


def why_late(deadlines: DeadlineAccount) -> str:
    """What made ticks miss their deadline, the most frequent cause first."""
    causes = sorted(deadlines.misses_by_cause.items(), key=lambda item: -item[1])
    listed = ", ".join(f"{count} times {cause.value}" for cause, count in causes if count)
    missed = f"{deadlines.deadline_misses} of {deadlines.ticks} ticks missed their deadline"
    return f"{listed}: {missed}" if listed else missed


def _line(p: Percentiles) -> str:
    return f"p50 {p.p50:.0f}, p99 {p.p99:.0f}, p99.9 {p.p999:.0f}, max {p.max:.0f}"


def live_lines(session: ControllerSession) -> Iterator[Line]:
    """Endless lines about the present; one has what the system granted to the loop as its note.

    The first one after each of two requests to stop says how to end at once. The first one after
    frames were lost in the log warns of it.
    """
    for line in _plain_lines(session):
        failure = "" if session.recorder is None else session.recorder.new_failure()
        yield line._replace(warning=failure)


def _plain_lines(session: ControllerSession) -> Iterator[Line]:
    while not session.is_joined:
        yield Line("waiting for the vehicle")
    granted = "" if session.is_lockstep else session.guarantees.sentence()
    yield _live_line(session.record)._replace(note=granted)
    for requests, note in enumerate((STOPPING, STILL_STOPPING)):
        while session.stop_requests <= requests:
            yield _live_line(session.record)
        yield _live_line(session.record)._replace(note=note)
    while True:
        yield _live_line(session.record)


def _live_line(record: RunRecord) -> Line:
    result, deadlines = record.result, record.deadlines
    state, path = result.state, result.path
    where = (
        " " * 34
        if state is None or path is None
        else f"{state.vx_mps * 3.6:3.0f} km/h  lateral error {state.ey_m - path.c0_m:+.3f} m  "
    )
    figures = (
        f"{deadlines.ticks:6d}  missed {deadlines.deadline_misses}  "
        f"{where}wheel {degrees(result.control.steer_rad):+5.1f} deg"
    )
    return Line(f"{result.mode.name:10s}", figures)


def write_ticks(path: Path | None, deadlines: DeadlineAccount) -> None:
    """Write a CSV row for each of the last ticks, oldest first; None writes nothing.

    Columns: the number of the tick in the run, then the fields of `TickTimes`.

    Raises:
        OutputError: the file cannot be written any more.
    """
    if path is None:
        return
    times = deadlines.last()
    rows = np.column_stack([np.arange(deadlines.ticks - len(times), deadlines.ticks), times])
    header = ",".join(("tick", *TickTimes._fields))
    formats = ["%d", *["%.1f"] * times.shape[1]]
    try:
        with atomic_write(path) as file:
            np.savetxt(file, rows, fmt=formats, delimiter=",", header=header, comments="")
    except OSError as error:
        raise OutputError(
            f"--ticks {path}: expected a file that can be written, found {error.strerror}. The run "
            f"itself is complete; only this file is missing. Free some space before the next one."
        ) from error
