"""Explanation of one tick of a recorded drive, by a replay up to this tick."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from cantools.database.can import Database

from rt_controller.bus.dbc import dbc_path, read_dbc
from rt_controller.bus.messages import MISSION, PREVIEW, REFERENCE
from rt_controller.bus.receive import Inbox
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.faults import Fault, StopCause
from rt_controller.contract.limits import InputLimits
from rt_controller.contract.signals import INPUT_UNITS, NEUTRAL_INPUT, ControlInput, Mode
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.explanation import PlanExplanation
from rt_controller.recording.journal import RECEIVED, SENT, TickRecord
from rt_controller.recording.replay import Difference, RecordedDrive, Replay, differences
from rt_controller.safety.checks import Check, is_computed
from rt_controller.safety.freshness import (
    REFERENCE_MAX_AGE_NS,
    STATE_MAX_AGE_NS,
    TIMING_SLACK_NS,
)
from rt_controller.safety.tick import Tick

_WITHOUT_QP = {
    Mode.STANDBY: "pedals released: the controller does not drive",
    Mode.NOMINAL: "plan of this tick",
    Mode.HOLD_PLAN: "next inputs of the last plan ({})",
    Mode.LOW_SPEED: "low-speed law, without a QP",
    Mode.STANDSTILL: "brake that holds the car, without a QP",
    Mode.SAFE_STOP: "pedals of a safe stop, without a QP (last plan: {})",
}
"""by mode; the last plan is filled in"""
_UNITS = {
    "PER_M": "1/m",
    "M": "m",
    "MPS": "m/s",
    "MPS2": "m/s^2",
    "MPS3": "m/s^3",
    "RAD": "rad",
    "RADPS": "rad/s",
    "N": "N",
    "TICKS": "ticks",
}
"""by the end of the name of a quantity, the longer one first"""


class Margin(NamedTuple):
    """A quantity that a check compares with its limit."""

    check: str
    value: float | None
    """None: there is nothing to check, which is a fault of its own where the check needs it"""
    limit: float
    unit: str

    @property
    def margin(self) -> float | None:
        """Limit minus value; negative if the value is beyond the limit."""
        return None if self.value is None else self.limit - self.value

    @property
    def text(self) -> str:
        """Check, value and limit for people."""
        value = "nothing to check" if self.value is None else f"{self.value:.4g}"
        return f"{self.check}, {value} of {self.limit:.4g} {self.unit}"


def plausibility_margins(values: Sequence[float], checks: Sequence[Check]) -> list[Margin]:
    """The quantities of a tick, by `Quantity`, against the thresholds of these checks."""
    margins = []
    for check in checks:
        value, name = values[check.quantity], check.quantity.name
        unit = next((unit for end, unit in _UNITS.items() if name.endswith(f"_{end}")), "1")
        computed = value if is_computed(value) else None
        margins.append(Margin(check.name, computed, check.threshold, unit))
    return margins


def exceeded(margins: Iterable[Margin]) -> list[Margin]:
    """Those whose value is beyond its limit; some checks act only after several ticks in a row."""
    return [each for each in margins if each.margin is not None and each.margin < 0.0]


def _data_margins(inbox: Inbox, now_ns: int, state_age_ns: int | None) -> Iterator[Margin]:
    """Ages of what was received, at the beginning of a tick."""
    path, preview, mission = (inbox.newest(each) for each in (REFERENCE, PREVIEW, MISSION))
    valid_for_ns = 0 if mission is None else mission.content.valid_for_ns
    ages_ns = [
        None if each is None else now_ns - each.arrival_ns for each in (path, preview, mission)
    ]
    path_limit_ns = REFERENCE_MAX_AGE_NS + TIMING_SLACK_NS
    for name, age_ns, limit_ns in (
        ("age of the state, with its transport", state_age_ns, STATE_MAX_AGE_NS),
        ("age of the path", ages_ns[0], path_limit_ns),
        ("age of the curvature ahead", ages_ns[1], path_limit_ns),
        ("age of the mission", ages_ns[2], valid_for_ns + TIMING_SLACK_NS),
    ):
        yield Margin(name, None if age_ns is None else age_ns * 1e-6, limit_ns * 1e-6, "ms")


def _command_margins(
    now: ControlInput, before: ControlInput, limits: InputLimits
) -> Iterator[Margin]:
    """The command of a tick against its bounds and rates; the envelope keeps it within them."""
    names = now._fields
    for name, value, bound, unit in zip(names, now, limits.upper, INPUT_UNITS, strict=True):
        yield Margin(f"size of {name}", abs(value), bound, unit)
    rates = limits.rate_per_s
    for name, value, old, rate, unit in zip(names, now, before, rates, INPUT_UNITS, strict=True):
        if name != "throttle" or value >= old:  # a throttle that closes is not limited
            change = abs(value - old)
            yield Margin(f"change of {name} in this period", change, rate * PERIOD_S, unit)


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

    record: TickRecord
    result: Tick
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
    before, last_plan = NEUTRAL_INPUT, "none"
    deadline_us = 1e3 * replay.config.realtime.deadline_ms
    for tick in replay.ticks():
        record, result = tick.recorded, tick.result
        if result.qp_ns > 0:
            last_plan = f"tick {record.tick}"
        if record.tick != number:
            before = result.control
            continue
        node = replay.node
        margins = (
            *_data_margins(node.inbox, record.began_ns, node.step.state_age_ns(record.began_ns)),
            *plausibility_margins(node.supervisor.values, node.supervisor.checks),
            *_command_margins(result.control, before, result.limits),
        )
        beyond = [f"beyond its limit: {each.text}" for each in exceeded(margins)]
        plan = replay.mpc.explain_plan() if result.qp_ns > 0 else None
        sent = Margin("time until the frames were sent", record.sent_after_us, deadline_us, "us")
        return TickExplanation(
            record,
            result,
            tuple(_frames(record, read_dbc(dbc_path(drive.header.is_fd)))),
            tuple(differences(tick)),
            plan,
            (*margins, sent),
            deadline_us,
            (*_reasons(record, result, deadline_us), *beyond),
            _command_from(result, plan, last_plan),
        )
    raise ConfigError(
        f"--tick {number}: expected a tick of {drive.path}, found {_numbers_of(drive)}. Choose one "
        f"of these."
    )


def safe_stop_tick(drive: RecordedDrive) -> int:
    """Number of the tick in which the last safe stop of a drive began.

    Raises:
        ConfigError: it has none.
    """
    modes = [tick.mode for tick in drive.driven]
    begins = [
        tick.tick
        for tick, before in zip(drive.driven, [Mode.STANDBY, *modes], strict=False)
        if tick.mode is Mode.SAFE_STOP and before is not Mode.SAFE_STOP
    ]
    if not begins:
        raise ConfigError(
            f"{drive.path}: expected a drive with a safe stop, whose first tick is explained "
            f"without --tick, found none. Choose one of the ticks {_numbers_of(drive)} with --tick."
        )
    return begins[-1]


def _numbers_of(drive: RecordedDrive) -> str:
    numbers = [tick.tick for tick in drive.driven]
    return f"{numbers[0]} to {numbers[-1]}" if numbers else "none"


def _frames(record: TickRecord, database: Database) -> Iterator[ExplainedFrame]:
    for call in record.calls:
        if call.name not in (RECEIVED, SENT):
            continue
        for frame in call.frames:
            data, name = bytes(frame.data), f"{frame.arbitration_id:#x}"
            signals: dict[str, float | str] = {}
            try:
                message = database.get_message_by_frame_id(frame.arbitration_id)
                name = message.name
                for signal, value in message.decode_simple(data).items():
                    unit = message.get_signal_by_name(signal).unit
                    text = value if isinstance(value, int | float) else str(value)
                    signals[f"{signal}, {unit}" if unit else signal] = text
            except Exception:  # of another catalogue, or damaged: the bytes are shown
                signals = {}
            before_us = (record.began_ns - call.stamp_ns) / 1e3
            yield ExplainedFrame(call.name == SENT, before_us, name, data.hex().upper(), signals)


def _reasons(record: TickRecord, result: Tick, deadline_us: float) -> Iterator[str]:
    if result.cause is not StopCause.NONE:
        yield f"{result.mode.name}: {result.cause.value}"
    if record.skipped:
        yield f"{record.skipped} periods were skipped before this tick"
    if record.sent_after_us > deadline_us:
        yield (
            f"late: sent {record.sent_after_us:.0f} us after the scheduled instant, "
            f"{record.sent_after_us - deadline_us:.0f} us after the deadline: "
            f"{record.late_cause or 'not recorded'}"
        )
    for fault in Fault(result.faults):
        yield f"fault in the heartbeat: {fault.name}"


def _command_from(result: Tick, plan: PlanExplanation | None, last_plan: str) -> str:
    if plan is None:
        return _WITHOUT_QP[result.mode].format(last_plan)
    text = "plan of this tick"
    if result.mode is Mode.SAFE_STOP:
        text = f"pedals of a safe stop, steering wheel of the {text}"
    if result.state is None:
        return f"{text}, which begins at an estimated state: none was received"
    if Fault.STATE_IMPLAUSIBLE in result.faults:
        return f"{text}, which begins at a state that is partly estimated"
    return text


def to_json(tick: TickExplanation) -> dict[str, Any]:
    """The explanation with units in its keys."""
    record, result, plan = tick.record, tick.result, tick.plan
    return {
        "tick": record.tick,
        "began_ns": record.began_ns,
        "mode": result.mode.name,
        "cause": result.cause.name,
        "reasons": list(tick.reasons),
        "command_from": tick.command_from,
        "is_identical": not tick.differences,
        "differences": [each._asdict() for each in tick.differences],
        "state": None if result.state is None else result.state._asdict(),
        "curvature_per_m": None if result.state is None else result.curvature_per_m,
        "path": None if result.path is None else result.path._asdict(),
        "control": result.control._asdict(),
        "faults": [fault.name for fault in Fault(result.faults)],
        "frames": [each._asdict() for each in tick.frames],
        "plan": None
        if plan is None
        else {
            "inputs": [ControlInput(*row)._asdict() for row in plan.inputs.tolist()],
            "predicted_states": plan.states.tolist(),
            "reference_states": plan.reference.tolist(),
            "active_bounds": [each._asdict() for each in plan.active],
            "cost_shares": [each._asdict() for each in plan.costs],
            "second_solution": {**plan.second._asdict(), "status": plan.second.status.name},
        },
        "checks": [{**each._asdict(), "margin": each.margin} for each in tick.margins],
        "deadline_us": tick.deadline_us,
        "sent_after_us": record.sent_after_us,
        "late_cause": record.late_cause if record.sent_after_us > tick.deadline_us else None,
        "skipped_ticks": record.skipped,
        "stage_times": dict(record.times),
    }
