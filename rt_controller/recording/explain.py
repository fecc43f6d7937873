"""Explanation of one tick of a recorded drive, by a replay up to this tick."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import can
from cantools.database.can import Database

from rt_controller.bus.dbc import dbc_path, read_dbc
from rt_controller.bus.messages import Fault
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, Mode
from rt_controller.control.explanation import PlanExplanation
from rt_controller.recording.header import recorded_config
from rt_controller.recording.journal import RECEIVED, SENT, JournalTick
from rt_controller.recording.margins import (
    Margin,
    command_margins,
    data_margins,
    exceeded,
    plausibility_margins,
)
from rt_controller.recording.recorded_drive import RecordedDrive, RecordedTick
from rt_controller.recording.replay import Difference, Replay, differences
from rt_controller.safety.modes import StopCause
from rt_controller.step import StepResult

_WITHOUT_QP = {
    Mode.STANDBY: "pedals released: the controller does not drive",
    Mode.NOMINAL: "plan of this tick",
    Mode.HOLD_PLAN: "next inputs of the last plan ({})",
    Mode.LOW_SPEED: "low-speed law, without a QP",
    Mode.STANDSTILL: "brake that holds the car, without a QP",
    Mode.SAFE_STOP: "pedals of a safe stop, without a QP (last plan: {})",
}
"""by mode; the last plan is filled in"""


class ExplainedFrame(NamedTuple):
    """One frame that was read or sent since the tick before."""

    is_sent: bool
    before_tick_us: float
    """how long before the beginning of the tick it was read, or sent if negative"""
    name: str
    """of the message; its id where the catalogue has none"""
    data_hex: str
    signals: dict[str, float | str]
    """by name and unit; empty if they cannot be decoded"""


@dataclass(frozen=True, slots=True)
class TickExplanation:
    """What a tick received, computed and sent, and why."""

    journal: JournalTick
    result: StepResult
    frames: tuple[ExplainedFrame, ...]
    differences: tuple[Difference, ...]
    """from the recorded command; if there are any, another computation is explained"""
    plan: PlanExplanation | None
    """None: no QP was solved in this tick"""
    margins: tuple[Margin, ...]
    deadline_us: float
    reasons: tuple[str, ...]
    """why the tick was late or degraded, for people; empty if it was neither"""
    command_from: str
    """what the command was made from, for people"""


def explain_tick(drive: RecordedDrive, replay: Replay, number: int) -> TickExplanation:
    """The explanation of tick `number`, counted from zero; replays the ticks before it.

    Raises:
        ConfigError: the drive has no such tick.
    """
    before: ControlInput = NEUTRAL_INPUT
    last_plan: int | None = None
    for tick in replay.ticks():
        if tick.result.qp_ns > 0:
            last_plan = tick.recorded.journal.number
        if tick.recorded.journal.number == number:
            differing = tuple(differences(tick))
            return _explain(drive, replay, tick.recorded, before, last_plan, differing)
        before = tick.result.control
    raise ConfigError(
        f"--tick {number}: expected a tick of {drive.path}, found {_numbers_of(drive)}. Choose one "
        f"of these."
    )


def safe_stop_tick(drive: RecordedDrive) -> int:
    """Number of the tick in which the last safe stop of a drive began.

    Raises:
        ConfigError: it has none.
    """
    found, before = None, Mode.STANDBY
    for each in drive.ticks:
        journal = each.journal
        if journal.mode is Mode.SAFE_STOP and before is not Mode.SAFE_STOP and journal.number >= 0:
            found = journal.number
        before = journal.mode
    if found is None:
        raise ConfigError(
            f"{drive.path}: expected a drive with a safe stop, whose first tick is explained "
            f"without --tick, found none. Choose one of the ticks {_numbers_of(drive)} with --tick."
        )
    return found


def _explain(
    drive: RecordedDrive,
    replay: Replay,
    recorded: RecordedTick,
    before: ControlInput,
    last_plan: int | None,
    differing: tuple[Difference, ...],
) -> TickExplanation:
    journal, step = recorded.journal, replay.node.step
    result = step.result
    deadline_us = 1e3 * recorded_config(drive.header).realtime.deadline_ms
    now_ns = journal.began_ns
    margins = (
        *data_margins(replay.node.inbox, now_ns, step.state_age_ns(now_ns)),
        *plausibility_margins(replay.node.supervisor.values),
        *command_margins(result.control, before, result.most_steer_rad),
        Margin("time until the frames were sent", journal.sent_after_us, deadline_us, "us"),
    )
    plan = replay.mpc.explain_plan() if result.qp_ns > 0 else None
    return TickExplanation(
        journal,
        result,
        _frames(recorded, read_dbc(dbc_path(drive.is_fd))),
        differing,
        plan,
        margins,
        deadline_us,
        (*_reasons(journal, result, deadline_us), *_beyond(margins[:-1])),
        _command_from(result, plan, last_plan),
    )


def _numbers_of(drive: RecordedDrive) -> str:
    numbers = [each.journal.number for each in drive.ticks if each.journal.number >= 0]
    return f"{numbers[0]} to {numbers[-1]}" if numbers else "none"


def _frames(recorded: RecordedTick, database: Database) -> tuple[ExplainedFrame, ...]:
    return tuple(
        _frame(frame, call.name == SENT, call.stamp_ns - recorded.journal.began_ns, database)
        for call, frames in recorded.calls
        if call.name in (RECEIVED, SENT)
        for frame in frames
    )


def _frame(frame: can.Message, is_sent: bool, after_ns: int, database: Database) -> ExplainedFrame:
    data, name = bytes(frame.data), f"{frame.arbitration_id:#x}"
    signals: dict[str, float | str] = {}
    try:
        message = database.get_message_by_frame_id(frame.arbitration_id)
        name = message.name
        decoded = message.decode_simple(data)
    except Exception:  # of another catalogue, or damaged: the bytes are shown
        decoded = {}
    for signal, value in decoded.items():
        unit = message.get_signal_by_name(signal).unit
        text = value if isinstance(value, int | float) else str(value)
        signals[f"{signal}, {unit}" if unit else signal] = text
    return ExplainedFrame(is_sent, -after_ns / 1e3, name, data.hex().upper(), signals)


def _reasons(journal: JournalTick, result: StepResult, deadline_us: float) -> list[str]:
    reasons = []
    if result.cause is not StopCause.NONE:
        reasons.append(f"{result.mode.name}: {result.cause.value}")
    if journal.skipped:
        reasons.append(f"{journal.skipped} periods were skipped before this tick")
    if journal.sent_after_us > deadline_us:
        cause = journal.late_cause or "not recorded"
        reasons.append(
            f"late: sent {journal.sent_after_us:.0f} us after the scheduled instant, "
            f"{journal.sent_after_us - deadline_us:.0f} us after the deadline: {cause}"
        )
    for fault in Fault(result.faults):
        reasons.append(f"fault in the heartbeat: {fault.name}")
    return reasons


def _beyond(margins: tuple[Margin, ...]) -> list[str]:
    return [f"beyond its limit: {each.text}" for each in exceeded(margins)]


def _command_from(result: StepResult, plan: PlanExplanation | None, last_plan: int | None) -> str:
    if result.mode is Mode.SAFE_STOP:
        text = "pedals of a safe stop, steering wheel of the plan of this tick"
    else:
        text = "plan of this tick"
    if plan is None:
        return _WITHOUT_QP[result.mode].format("none" if last_plan is None else f"tick {last_plan}")
    if result.state is None:
        return f"{text}, which begins at an estimated state: none was received"
    if Fault.STATE_IMPLAUSIBLE in result.faults:
        return f"{text}, which begins at a state that is partly estimated"
    return text


def to_json(tick: TickExplanation) -> dict[str, Any]:
    """The explanation with units in its keys."""
    journal, result, plan = tick.journal, tick.result, tick.plan
    return {
        "tick": journal.number,
        "began_ns": journal.began_ns,
        "mode": result.mode.name,
        "cause": result.cause.name,
        "reasons": list(tick.reasons),
        "command_from": tick.command_from,
        "is_identical": not tick.differences,
        "differences": [each._asdict() for each in tick.differences],
        "state": None if result.state is None else result.state.state._asdict(),
        "curvature_per_m": None if result.state is None else result.state.curvature_per_m,
        "path": None if result.path is None else result.path._asdict(),
        "control": result.control._asdict(),
        "faults": [fault.name for fault in Fault(result.faults)],
        "frames": [each._asdict() for each in tick.frames],
        "plan": None if plan is None else _plan_to_json(plan),
        "checks": [{**each._asdict(), "margin": each.margin} for each in tick.margins],
        "deadline_us": tick.deadline_us,
        "sent_after_us": journal.sent_after_us,
        "late_cause": journal.late_cause if journal.sent_after_us > tick.deadline_us else None,
        "skipped_ticks": journal.skipped,
        "stage_times": dict(journal.times),
    }


def _plan_to_json(plan: PlanExplanation) -> dict[str, Any]:
    return {
        "inputs": [ControlInput(*row)._asdict() for row in plan.inputs.tolist()],
        "predicted_states": plan.states.tolist(),
        "reference_states": plan.reference.tolist(),
        "active_bounds": [each._asdict() for each in plan.active],
        "cost_shares": [each._asdict() for each in plan.costs],
        "second_solution": {**plan.second._asdict(), "status": plan.second.status.name},
    }
