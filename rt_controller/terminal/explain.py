"""`rt-controller explain`: one tick of a recorded drive as tables."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
from rich.console import Console
from threadpoolctl import threadpool_limits

from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.signals import ControlInput, Mode, VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.explanation import PlanExplanation
from rt_controller.recording.explain import (
    TickExplanation,
    explain_tick,
    safe_stop_tick,
    to_json,
)
from rt_controller.recording.margins import Margin
from rt_controller.recording.recorded_drive import read_recorded_drive
from rt_controller.report.table import (
    NO_VALUE,
    Cell,
    Column,
    Fact,
    Table,
    facts_table,
    format_number,
    print_table,
)
from rt_controller.terminal.progress import announce
from rt_controller.terminal.replay import open_replay

_ROUNDING = 1e-12
ONLY_STEERING = " (only its steering wheel is used)"
"""of the plan of a safe stop, whose pedals are those of the stop"""


def explain_at_terminal(
    log: Path,
    number: int | None,
    model: str | Path | None,
    json_file: Path | None,
    is_quiet: bool,
) -> int:
    """Print the explanation of a tick; the exit code of the program.

    Without a `number` it is the tick in which the last safe stop began.

    Raises:
        ConfigError, ArtifactError, MissingExtraError: the drive cannot be replayed, or has no such
            tick.
    """
    require_writable(json_file)
    with announce(f"reading {log}", is_quiet):
        drive = read_recorded_drive(log)
        number = safe_stop_tick(drive) if number is None else number
    with (
        announce(f"replaying {log} up to tick {number}", is_quiet),
        threadpool_limits(1, "blas"),
        closing(open_replay(drive, model)) as replay,
    ):
        tick = explain_tick(drive, replay, number)
    for table in _tables(tick):
        print_table(table, Console())
    write_figures(json_file, to_json(tick))
    return 0


def _tables(tick: TickExplanation) -> Iterator[Table]:
    yield facts_table(_facts(tick), f"tick {tick.journal.number}")
    yield _frames(tick)
    if tick.plan is not None:
        is_stop = tick.result.mode is Mode.SAFE_STOP
        yield from _plan_tables(tick.plan, ONLY_STEERING if is_stop else "")
    yield _checks(tick)
    if tick.journal.times:
        yield _times(tick.journal.times)


def _facts(tick: TickExplanation) -> Iterator[Fact]:
    result = tick.result
    yield Fact("mode", result.mode.name)
    if tick.differences:
        names = ", ".join(each.signal for each in tick.differences)
        yield Fact("note", f"this program computes another {names} than was recorded")
    for reason in tick.reasons:
        yield Fact("why", reason)
    if result.state is not None:
        yield Fact("state", _listed(result.state.state._asdict()))
        yield Fact("curvature", f"{result.state.curvature_per_m:.6g} 1/m")
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


def _frames(tick: TickExplanation) -> Table:
    columns = (
        Column("", is_text=True),
        Column("before the tick", "us"),
        Column("message", is_text=True),
        Column("signals", is_text=True),
    )
    rows = tuple(
        (
            "sent" if frame.is_sent else "received",
            f"{frame.before_tick_us:.0f}",
            frame.name,
            _listed(frame.signals) if frame.signals else frame.data_hex,
        )
        for frame in tick.frames
    )
    return Table("frames", columns, rows)


def _plan_tables(plan: PlanExplanation, note: str) -> Iterator[Table]:
    names = (*VehicleState._fields, *ControlInput._fields)
    columns = (Column("in", "s"), *(Column(name) for name in names))
    nothing = np.full((1, plan.inputs.shape[1]), np.nan)
    rows = np.hstack([plan.states, np.vstack([plan.inputs, nothing])])
    rows[np.abs(rows) < _ROUNDING] = 0.0
    yield Table(
        f"plan{note}: predicted states and inputs",
        columns,
        tuple(
            (f"{stage * PERIOD_S:.3f}", *(format_number(value) for value in row))
            for stage, row in enumerate(rows.tolist())
        ),
    )
    heads = (
        Column("bound", is_text=True),
        Column("stages", is_text=True),
        Column("largest multiplier"),
    )
    grouped: dict[str, list[tuple[int, float]]] = {}
    for bound in plan.active:
        name = f"{bound.kind} of {bound.signal}, {bound.side}"
        grouped.setdefault(name, []).append((bound.stage, bound.multiplier))
    yield Table(
        "active bounds",
        heads,
        tuple(
            (
                name,
                _ranges([stage for stage, _ in found]),
                f"{max(abs(m) for _, m in found):.3g}",
            )
            for name, found in grouped.items()
        ),
    )
    yield Table(
        "cost",
        (Column("term", is_text=True), Column("cost"), Column("share", "%")),
        tuple(
            (
                each.term,
                format_number(each.cost if each.share > _ROUNDING else 0.0),
                f"{100 * each.share:.1f}",
            )
            for each in plan.costs
        ),
    )


def _checks(tick: TickExplanation) -> Table:
    columns = (
        Column("check", is_text=True),
        Column("value"),
        Column("limit"),
        Column("margin"),
        Column("unit", is_text=True),
    )
    rows = tuple(
        (
            each.check,
            format_number(np.nan if each.value is None else each.value),
            format_number(each.limit),
            _margin(each),
            each.unit,
        )
        for each in tick.margins
    )
    return Table("checks", columns, rows)


def _margin(of: Margin) -> Cell:
    """Marked where the value is beyond the limit."""
    if of.margin is None:
        return Cell(NO_VALUE)
    return Cell(format_number(of.margin), status="bad" if of.margin < 0.0 else "")


def _times(times: Mapping[str, float]) -> Table:
    columns = (Column("stage", is_text=True), Column("time", "us"))
    rows = tuple(
        (name.removesuffix("_us").replace("_", " "), f"{value:.1f}")
        for name, value in times.items()
        if name.endswith("_us")
    )
    return Table("times of the stages", columns, rows)


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
