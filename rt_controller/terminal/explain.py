"""`rt-controller explain LOG`, `replay LOG --tick N`: a page about one tick of a recorded drive."""

from collections.abc import Iterator
from contextlib import closing
from math import isnan, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from threadpoolctl import threadpool_limits

from rt_controller.bus.messages import MISSION, PREVIEW, REFERENCE
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.faults import Fault, StopCause
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.signals import NEUTRAL_INPUT, VEHICLE, ControlInput, Mode
from rt_controller.contract.timing import PERIOD_S
from rt_controller.recording.replay import (
    RecordedDrive,
    Replay,
    ReplayedTick,
    differences,
    read_recorded_drive,
)
from rt_controller.report.table import (
    Column,
    Fact,
    Table,
    facts_table,
    format_number,
    print_table,
    print_text,
)
from rt_controller.safety.freshness import REFERENCE_MAX_AGE_NS, STATE_MAX_AGE_NS, TIMING_SLACK_NS
from rt_controller.safety.tick import Tick
from rt_controller.terminal.progress import announce
from rt_controller.terminal.stop_message import Margin, exceeded, plausibility_margins

if TYPE_CHECKING:
    from rt_controller.terminal.options import ExplainOptions, ReplayOptions

_DEGRADED = {
    Mode.SAFE_STOP: "was part of a safe stop",
    Mode.HOLD_PLAN: "followed the last plan",
    Mode.STANDBY: "did not drive",
}
_WITHOUT_QP = {
    Mode.STANDBY: "pedals released: the controller does not drive",
    Mode.NOMINAL: "plan of this tick",
    Mode.HOLD_PLAN: "next inputs of the last plan ({})",
    Mode.LOW_SPEED: "low-speed law, without a QP",
    Mode.STANDSTILL: "brake that holds the car, without a QP",
    Mode.SAFE_STOP: "pedals of a safe stop, without a QP (last plan: {})",
}
"""by mode; the last plan is filled in"""
_NO_FACTS = ("sentence", "checks", "stage_times")


def explain_at_terminal(log: Path, options: "ExplainOptions | ReplayOptions") -> int:
    """Print the page about a tick; the exit code of the program."""
    require_writable(options.json_file, inputs=(log,))
    with announce(f"replaying {log} up to one tick", options.quiet), threadpool_limits(1, "blas"):
        drive = read_recorded_drive(log)
        with closing(Replay(drive, options.model)) as replay:
            number = _begin_of_stop(drive) if options.tick is None else options.tick
            page = _explain(drive, replay, number)
    print_text(page["sentence"], Console())
    for table in _tables(page):
        print_table(table, Console())
    write_figures(options.json_file, page)
    return 0


def _begin_of_stop(drive: RecordedDrive) -> int:
    begin, before = None, Mode.STANDBY
    for tick in drive.driven:
        if tick.mode is Mode.SAFE_STOP and before is not Mode.SAFE_STOP:
            begin = tick.tick
        before = tick.mode
    if begin is None:
        raise ConfigError(
            f"{drive.path}: expected a drive with a safe stop, whose first tick is explained "
            f"without --tick, found none. Choose one of the ticks {_numbers_of(drive)} with --tick."
        )
    return begin


def _numbers_of(drive: RecordedDrive) -> str:
    numbers = [tick.tick for tick in drive.driven]
    return f"{numbers[0]} to {numbers[-1]}" if numbers else "none"


def _explain(drive: RecordedDrive, replay: Replay, number: int) -> dict[str, Any]:
    """The page about tick `number`, counted from zero, after a replay of the ticks before it."""
    before, last_plan = NEUTRAL_INPUT, "none"
    for tick in replay.ticks():
        if tick.result.qp_ns > 0:
            last_plan = f"tick {tick.recorded.tick}"
        if tick.recorded.tick == number:
            return _page(tick, replay, before, last_plan)
        before = tick.result.control
    raise ConfigError(
        f"--tick {number}: expected a tick of {drive.path}, found {_numbers_of(drive)}. Choose one "
        f"of these."
    )


def _page(
    tick: ReplayedTick, replay: Replay, before: ControlInput, last_plan: str
) -> dict[str, Any]:
    """What a tick received, decided and sent, and why, as in `--json`: names end in their units."""
    record, result = tick.recorded, tick.result
    deadline_us, sent_us = 1e3 * replay.config.realtime.deadline_ms, record.sent_after_us
    margins = list(_margins(replay, record.began_ns, result, before))
    reasons = []
    if record.skipped:
        reasons.append(f"{record.skipped} periods were skipped before this tick")
    if sent_us > deadline_us:
        reasons.append(
            f"late: sent {sent_us:.0f} us after the scheduled instant, {sent_us - deadline_us:.0f} "
            f"us after the deadline: {record.late_cause or 'not recorded'}"
        )
    reasons += [f"fault in the heartbeat: {fault.name}" for fault in Fault(result.faults)]
    reasons += [f"beyond its limit: {each.text}" for each in exceeded(margins)]
    margins.append(Margin("time until the frames were sent", sent_us, deadline_us, "us"))
    command_from, changed = _command_from(result, last_plan), differences(tick)
    happened = f"Tick {record.tick} {_DEGRADED.get(result.mode, 'drove')}"
    if changed:
        sentence = (
            f"Tick {record.tick} is explained as this program computes it, with another "
            f"{', '.join(each.signal for each in changed)} than was recorded; use the version and "
            f"the model that recorded it to see what happened."
        )
    elif result.cause is not StopCause.NONE:
        sentence = f"{happened}: {result.cause.value}. {result.cause.remedy}".strip()
    elif reasons:
        sentence = f"{happened}; {reasons[0]}."
    else:
        sentence = f"{happened}, and nothing was wrong: {command_from}."
    return {
        "sentence": sentence,
        "tick": record.tick,
        "is_identical": not changed,
        "mode": result.mode.name,
        "cause": result.cause.name,
        "remedy": result.cause.remedy,
        "reasons": reasons,
        "state": None if result.state is None else result.state._asdict(),
        "curvature_per_m": None if result.state is None else result.curvature_per_m,
        "path": None if result.path is None else result.path._asdict(),
        "control": result.control._asdict(),
        "command_from": command_from,
        "checks": [
            {**each._asdict(), "margin": each.margin}
            for each in sorted(margins, key=lambda each: (isnan(each.value), each.share_left))
        ],
        "stage_times": dict(record.times),
    }


def _command_from(result: Tick, last_plan: str) -> str:
    if result.qp_ns == 0:
        return _WITHOUT_QP[result.mode].format(last_plan)
    text = "plan of this tick"
    if result.mode is Mode.SAFE_STOP:
        text = f"pedals of a safe stop, steering wheel of the {text}"
    if result.state is None:
        return f"{text}, which begins at an estimated state: none was received"
    if Fault.STATE_IMPLAUSIBLE in result.faults:
        return f"{text}, which begins at a state that is partly estimated"
    return text


def _margins(replay: Replay, now_ns: int, result: Tick, before: ControlInput) -> Iterator[Margin]:
    """Ages of what was received, the checks, and the command against its bounds and rates."""
    node, limits = replay.node, result.limits
    state_age_ns, mission = node.step.state_age_ns(now_ns), node.inbox.newest(MISSION)
    age_ms = nan if state_age_ns is None else state_age_ns * 1e-6
    yield Margin("age of the state, with its transport", age_ms, STATE_MAX_AGE_NS * 1e-6, "ms")
    for name, received, limit_ns in (
        ("path", node.inbox.newest(REFERENCE), REFERENCE_MAX_AGE_NS),
        ("curvature ahead", node.inbox.newest(PREVIEW), REFERENCE_MAX_AGE_NS),
        ("mission", mission, 0 if mission is None else mission.content.valid_for_ns),
    ):
        age_ms = nan if received is None else (now_ns - received.arrival_ns) * 1e-6
        yield Margin(f"age of the {name}", age_ms, (limit_ns + TIMING_SLACK_NS) * 1e-6, "ms")
    yield from plausibility_margins(node.supervisor.values, node.supervisor.checks)
    columns = (result.control, before, limits.upper, limits.rate_per_s)
    for (name, unit), now, old, bound, rate in zip(VEHICLE.inputs, *columns, strict=True):
        yield Margin(f"size of {name}", abs(now), bound, unit)
        if name != "throttle" or now >= old:  # a throttle that closes is not limited
            change = abs(now - old)
            yield Margin(f"change of {name} in this period", change, rate * PERIOD_S, unit)


def _tables(page: dict[str, Any]) -> Iterator[Table]:
    facts = [(name, _text(value)) for name, value in page.items() if name not in _NO_FACTS]
    yield facts_table(Fact(name.replace("_", " "), text) for name, text in facts if text)
    name, *numbers = Column("check", is_text=True), *map(Column, ("value", "limit", "margin"))
    rows = [
        (each["check"], *(format_number(each[key.title]) for key in numbers), each["unit"])
        for each in page["checks"]
    ]
    yield Table("checks", (name, *numbers, Column("unit", is_text=True)), tuple(rows))
    times = [
        (key[:-3], f"{us:.1f}") for key, us in page["stage_times"].items() if key[-3:] == "_us"
    ]
    if times:
        columns = Column("stage", is_text=True), Column("time", "us")
        yield Table("times of the stages", columns, tuple(times))


def _text(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {number:.6g}" for name, number in value.items())
    if isinstance(value, list):
        return "\n".join(value)
    return "none" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)
