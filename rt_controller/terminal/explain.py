"""`rt-controller explain`: one tick of a recorded drive as a sentence and tables."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from math import inf
from pathlib import Path

import numpy as np
from rich.console import Console
from threadpoolctl import threadpool_limits

from rt_controller.contract.faults import StopCause
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.signals import ControlInput, Mode, VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.explanation import PlanExplanation
from rt_controller.recording.explain import (
    Margin,
    TickExplanation,
    explain_tick,
    safe_stop_tick,
    to_json,
)
from rt_controller.recording.replay import Replay, read_recorded_drive
from rt_controller.report.table import (
    NO_VALUE,
    Cell,
    Column,
    Fact,
    Row,
    Table,
    facts_table,
    format_number,
    print_table,
)
from rt_controller.terminal.progress import announce
from rt_controller.terminal.stop_message import remedy_of

_ROUNDING = 1e-12
ONLY_STEERING = " (only its steering wheel is used)"
"""of the plan of a safe stop, whose pedals are those of the stop"""
_DEGRADED = {
    Mode.SAFE_STOP: "was part of a safe stop",
    Mode.HOLD_PLAN: "followed the last plan",
    Mode.STANDBY: "did not drive",
}


def explain_at_terminal(
    log: Path,
    number: int | None,
    model: str | Path | None,
    json_file: Path | None,
    is_quiet: bool,
) -> int:
    """Print the explanation of a tick; the exit code of the program.

    Without a `number` it is the tick in which the last safe stop began.
    """
    require_writable(json_file)
    with announce(f"reading {log}", is_quiet):
        drive = read_recorded_drive(log)
        number = safe_stop_tick(drive) if number is None else number
    with (
        announce(f"replaying {log} up to tick {number}", is_quiet),
        threadpool_limits(1, "blas"),
        closing(Replay(drive, model)) as replay,
    ):
        tick = explain_tick(drive, replay, number)
    Console().print(_sentence(tick), highlight=False, markup=False, soft_wrap=True)
    for table in _tables(tick):
        print_table(table, Console())
    write_figures(json_file, to_json(tick))
    return 0


def _sentence(tick: TickExplanation) -> str:
    """What happened, why, and what to do."""
    number, result = tick.record.tick, tick.result
    if tick.differences:
        names = ", ".join(each.signal for each in tick.differences)
        return (
            f"Tick {number} is explained as this program computes it, with another {names} than "
            f"was recorded; use the version and the model that recorded it to see what happened."
        )
    happened = _DEGRADED.get(result.mode, "drove")
    if result.cause is not StopCause.NONE:
        return f"Tick {number} {happened}: {result.cause.value}. {remedy_of(result.cause)}".strip()
    if tick.reasons:
        return f"Tick {number} {happened}; {tick.reasons[0]}."
    return f"Tick {number} {happened}, and nothing was wrong: {tick.command_from}."


def _share_left(of: Margin) -> float:
    """What is left of the limit of a check; checks without a value come last."""
    return inf if of.margin is None else of.margin / (abs(of.limit) or 1.0)


def _tables(tick: TickExplanation) -> Iterator[Table]:
    yield facts_table(_facts(tick), f"tick {tick.record.tick}")
    checks = (
        (
            each.check,
            format_number(np.nan if each.value is None else each.value),
            format_number(each.limit),
            Cell(NO_VALUE)
            if each.margin is None
            else Cell(format_number(each.margin), status="bad" if each.margin < 0.0 else ""),
            each.unit,
        )
        for each in sorted(tick.margins, key=_share_left)
    )
    yield _table("checks", "check<|value|limit|margin|unit<", checks)
    frames = (
        (
            "sent" if frame.is_sent else "received",
            f"{frame.before_tick_us:.0f}",
            frame.name,
            _listed(frame.signals) if frame.signals else frame.data_hex,
        )
        for frame in tick.frames
    )
    yield _table("frames", "<|before the tick, us|message<|signals<", frames)
    if tick.plan is not None:
        is_stop = tick.result.mode is Mode.SAFE_STOP
        yield from _plan_tables(tick.plan, ONLY_STEERING if is_stop else "")
    times = (
        (name.removesuffix("_us").replace("_", " "), f"{value:.1f}")
        for name, value in tick.record.times.items()
        if name.endswith("_us")
    )
    if tick.record.times:
        yield _table("times of the stages", "stage<|time, us", times)


def _table(title: str, heads: str, rows: Iterator[Row]) -> Table:
    """A table of columns "title, unit|title<"; the mark < makes one of text."""
    columns = []
    for head in heads.split("|"):
        name, _, unit = head.rstrip("<").partition(", ")
        columns.append(Column(name, unit, is_text=head.endswith("<")))
    return Table(title, tuple(columns), tuple(rows))


def _facts(tick: TickExplanation) -> Iterator[Fact]:
    result = tick.result
    yield Fact("mode", result.mode.name)
    for reason in tick.reasons:
        yield Fact("why", reason)
    if result.state is not None:
        yield Fact("state", _listed(result.state._asdict()))
        yield Fact("curvature", f"{result.curvature_per_m:.6g} 1/m")
    if result.path is not None:
        yield Fact("path", _listed(result.path._asdict()))
    yield Fact("command", _listed(result.control._asdict()))
    yield Fact("from", tick.command_from)
    if tick.plan is not None:
        second = tick.plan.second
        yield Fact(
            "QP",
            f"{result.qp_iterations} iterations; solved again from a cold start: "
            f"{second.status.name}, {second.iterations} iterations, inputs differ by at most "
            f"{second.largest_difference:.1e} of their range; optimality residual "
            f"{second.optimality_residual:.1e}",
        )


def _plan_tables(plan: PlanExplanation, note: str) -> Iterator[Table]:
    nothing = np.full((1, plan.inputs.shape[1]), np.nan)
    values = np.hstack([plan.states, np.vstack([plan.inputs, nothing])])
    values[np.abs(values) < _ROUNDING] = 0.0
    stages = (
        (f"{stage * PERIOD_S:.3f}", *map(format_number, row))
        for stage, row in enumerate(values.tolist())
    )
    heads = "|".join(("in, s", *VehicleState._fields, *ControlInput._fields))
    yield _table(f"plan{note}: predicted states and inputs", heads, stages)
    grouped: dict[str, list[tuple[int, float]]] = {}
    for bound in plan.active:
        name = f"{bound.kind} of {bound.signal}, {bound.side}"
        grouped.setdefault(name, []).append((bound.stage, bound.multiplier))
    bounds = (
        (name, _ranges([stage for stage, _ in found]), f"{max(abs(m) for _, m in found):.3g}")
        for name, found in grouped.items()
    )
    yield _table("active bounds", "bound<|stages<|largest multiplier", bounds)
    costs = (
        (
            each.term,
            format_number(each.cost if each.share > _ROUNDING else 0.0),
            f"{100 * each.share:.1f}",
        )
        for each in plan.costs
    )
    yield _table("cost", "term<|cost|share, %", costs)


def _ranges(stages: Sequence[int]) -> str:
    """Increasing numbers, those in a row as a range: 0-4, 7."""
    found: list[list[int]] = []
    for stage in stages:
        if found and stage == found[-1][-1] + 1:
            found[-1].append(stage)
        else:
            found.append([stage])
    return ", ".join(str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in found)


def _listed(values: Mapping[str, float | str]) -> str:
    """Values as text; a key is a name, or a name and a unit with a comma between them."""
    texts = []
    for key, value in values.items():
        name, _, unit = key.partition(", ")
        number = f"{value:.6g}" if isinstance(value, float) else str(value)
        texts.append(f"{name} {number} {unit}".rstrip())
    return ", ".join(texts)
