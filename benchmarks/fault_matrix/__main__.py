"""`python -m benchmarks.fault_matrix`: every fault at every speed, as a table and as JSON."""

from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import cyclopts
from pydantic import Field
from rich.console import Console

from benchmarks.fault_matrix.cases import (
    CASES_FILE,
    CONDITIONS,
    CONDITIONS_FILE,
    SPEEDS_KMH,
    Case,
    load_cases,
    whole_matrix,
)
from benchmarks.fault_matrix.drive import drive_task
from benchmarks.fault_matrix.summary import lines_of, summarise
from benchmarks.fault_matrix.verdict import MatrixRow
from offline.commands.options import JsonFile, Several
from offline.commands.terminal import progress_bar
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.names import hint
from rt_controller.model.bundle import Bundle
from rt_controller.report.table import NO_VALUE, Cell, Column, Row, Table, print_table
from rt_controller.terminal.command_line import run_command
from sim_bridge.campaign import THIS_MACHINE, Backend, digest, run_campaign
from sim_bridge.scenario.limits import KMH_PER_MPS

EXIT_NOT_OK = 1
LEAST_WIDTH = 160
SAMPLE_STRIDE = 17
"""it leads to every condition, and to other cases and speeds each time"""
_UNITS = {
    "fault": "", "condition": "", "speed": "km/h", "mode": "", "detected": "ms",
    "max |e_y|": "m", "unchecked": "m", "ok": "", "reasons": "",
}  # fmt: skip
_COLUMNS = tuple(Column(title, unit, is_text=not unit) for title, unit in _UNITS.items())
_Speed = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]

app = cyclopts.App(name="python -m benchmarks.fault_matrix", version_flags=[])


class Task(NamedTuple):
    """One drive that is to be done."""

    case: Case
    speed_kmh: float

    @property
    def key(self) -> str:
        """Of its result; another one for a case with other content."""
        content = digest(self.case.model_dump())
        return f"{self.case.name} {self.case.condition} {self.speed_kmh:g} {content:.16}"


@app.default
def main(
    *,
    model: str | None = None,
    only: Annotated[tuple[str, ...], Several] = (),
    speed_kmh: Annotated[tuple[_Speed, ...], Several] = SPEEDS_KMH,
    cases: Path = CASES_FILE,
    conditions: Annotated[tuple[str, ...], Several] = (),
    sample: Annotated[bool, cyclopts.Parameter(negative="")] = False,
    drives: Path | None = None,
    backend: Backend = THIS_MACHINE,
    json: JsonFile = None,
) -> int:
    """Drive every fault of the matrix at three speeds, in simulated time; 1 if one is not ok.

    A drive is ok if the fault is detected within 0.5 s or is harmless, the car stays within 1.75 m
    of its true path or stands on it, and the controller does not drive on normally for longer than
    0.3 s at more than 1 m from the path, and no more than 0.2 m farther from it than in the same
    drive without checks.

    Args:
        model: that the controller plans with: a shipped name, or folder of a bundle.
        only: names of the faults to drive; default: all.
        speed_kmh: speeds to drive at.
        cases: TOML file with other faults, such as benchmarks/fault_matrix/variants.toml.
        conditions: names in conditions.toml, under each of which the cases are driven.
        sample: some cases of each kind of fault and condition only.
        drives: file with a line of JSON for each drive: what it already has is not driven again.
    """
    require_writable(json)
    require_writable(drives, "--drives")
    found = whole_matrix() if cases == CASES_FILE else load_cases(cases)
    _require_known("--only", only, {case.name for case in found}, cases)
    _require_known("--conditions", conditions, CONDITIONS, CONDITIONS_FILE)
    found = [case for case in found if not only or case.name in only]
    if conditions:
        found = [case.under(condition) for condition in conditions for case in found]
    tasks = [Task(case, speed) for case in found for speed in speed_kmh]
    if sample:
        tasks = sample_of(tasks)
    made_with = {"model_sha256": Bundle.load(model).sha256}  # refused here, not in a process
    calls = {task.key: (*task, model) for task in tasks}
    done = {}
    with progress_bar("drives", len(calls)) as show:
        for key, row in run_campaign(drive_task, calls.items(), backend, drives, made_with):
            done[key] = MatrixRow(**row)
            show(len(calls.keys() & done), done[key].fault)
    rows = [done[task.key] for task in tasks]
    console = Console()
    console.width = max(console.width, LEAST_WIDTH)
    print_table(Table("faults in simulated time", _COLUMNS, tuple(map(_cells, rows))), console)
    summary = summarise(rows)
    for line in lines_of(summary):
        console.print(line, highlight=False)
    write_figures(json, {"summary": summary._asdict(), "rows": [row._asdict() for row in rows]})
    return 0 if summary.drives_ok == summary.drives else EXIT_NOT_OK


def sample_of(tasks: Sequence[Task]) -> list[Task]:
    """One drive of each kind of fault, at speeds in turn, and every 17th under a condition."""
    found: dict[tuple[str, ...], Task] = {}
    speeds_kmh = sorted({task.speed_kmh for task in tasks}, reverse=True)
    for task in tasks:
        kinds = tuple(sorted({str(fault["kind"]) for fault in task.case.faults}))
        is_next = task.speed_kmh == speeds_kmh[len(found) % len(speeds_kmh)]
        if kinds not in found and is_next and not task.case.condition:
            found[kinds] = task
    return [*found.values(), *[task for task in tasks if task.case.condition][::SAMPLE_STRIDE]]


def _require_known(option: str, names: Iterable[str], known: Collection[str], file: Path) -> None:
    if unknown := [f"{name!r}{hint(name, known)}" for name in names if name not in known]:
        raise ConfigError(
            f"{option}: expected names in {file}, found {', '.join(unknown)}. Correct them."
        )


def _cells(row: MatrixRow) -> Row:
    return (
        row.fault,
        row.condition,
        f"{row.speed_mps * KMH_PER_MPS:.0f}",
        row.mode,
        NO_VALUE if row.detect_ms is None else f"{row.detect_ms:.0f}",
        f"{row.max_ey_m:.2f}",
        NO_VALUE if row.max_ey_unchecked_m is None else f"{row.max_ey_unchecked_m:.2f}",
        Cell("ok", status="good") if row.ok else Cell("NO", status="bad"),
        "; ".join(filter(None, (*row.reasons, row.known_limit))),
    )


if __name__ == "__main__":
    run_command(app)
