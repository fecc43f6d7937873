"""`sim-bridge fault-matrix`: every fault at every speed, as a table and as JSON."""

import json
import os
from collections.abc import Collection, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

from rich.console import Console

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.files import read_text
from rt_controller.contract.names import hint
from rt_controller.model.artifact import find_model, load_bundle
from rt_controller.model.bundle import Bundle
from rt_controller.report.table import NO_VALUE, Cell, Column, Row, Table, print_table
from rt_controller.terminal.progress import announce
from sim_bridge.faults.matrix.cases import (
    CASES_FILE,
    CONDITIONS,
    SPEEDS_KMH,
    Case,
    load_cases,
    whole_matrix,
)
from sim_bridge.faults.matrix.drive import drive_case
from sim_bridge.faults.matrix.row import MatrixRow
from sim_bridge.faults.matrix.summary import lines_of, summarise
from sim_bridge.scenario.limits import KMH_PER_MPS

EXIT_NOT_OK = 1
LEAST_WIDTH = 160
SAMPLE_STRIDE = 17
"""it leads to every condition, and to other cases and speeds each time"""
_Key = tuple[str, str, float]
_UNITS = {
    "fault": "", "condition": "", "speed": "km/h", "mode": "", "detected": "ms",
    "max |e_y|": "m", "unchecked": "m", "ok": "", "reasons": "",
}  # fmt: skip
_COLUMNS = tuple(Column(title, unit, is_text=not unit) for title, unit in _UNITS.items())


class Task(NamedTuple):
    """One drive that is to be done."""

    case: Case
    speed_kmh: float
    model: str | None

    @property
    def key(self) -> _Key:
        """That of its row."""
        return self.case.name, self.case.condition, round(self.speed_kmh / KMH_PER_MPS, 3)

    def drive(self) -> MatrixRow:
        """Its row."""
        return drive_case(self.case, self.speed_kmh, _bundle(self.model))


def fault_matrix(
    model: str | None,
    only: Sequence[str],
    speeds_kmh: Sequence[float],
    jobs: int | None,
    json_file: Path | None,
    cases_file: Path | None = None,
    conditions: Sequence[str] = (),
    drives_file: Path | None = None,
    is_sample: bool = False,
) -> int:
    """Drive all faults, or those of a file, at all speeds and print the rows; 1 if one is not ok.

    Raises:
        ConfigError: unknown faults, or a file that cannot be written.
        ArtifactError: the model cannot be used.
    """
    require_writable(json_file)
    require_writable(drives_file, "--drives")
    cases = whole_matrix() if cases_file is None else load_cases(cases_file)
    _require_known("--only", only, {case.name for case in cases}, cases_file or CASES_FILE)
    _require_known("--conditions", conditions, CONDITIONS, CASES_FILE.with_name("conditions.toml"))
    cases = [case for case in cases if not only or case.name in only]
    if conditions:
        cases = [case.under(condition) for condition in conditions for case in cases]
    bundle = _bundle(model)  # a model is refused here, not in a process
    done = _earlier(drives_file, bundle)
    tasks = [Task(case, speed, model) for case in cases for speed in speeds_kmh or SPEEDS_KMH]
    if is_sample:
        tasks = sample(tasks)
    todo = [task for task in tasks if task.key not in done]
    jobs = min(jobs or len(os.sched_getaffinity(0)), max(len(todo), 1))
    with announce(f"{len(todo)} drives, {jobs} at a time"):
        for task, row in zip(todo, _drive_all(todo, jobs), strict=True):
            done[task.key] = row
            if drives_file is not None:
                with drives_file.open("a", encoding="utf-8") as file:
                    file.write(json.dumps({"model": bundle.sha256, "row": row._asdict()}) + "\n")
    rows = [done[task.key] for task in tasks]
    console = Console()
    console.width = max(console.width, LEAST_WIDTH)
    print_table(Table("faults in simulated time", _COLUMNS, tuple(map(_cells, rows))), console)
    summary = summarise(rows)
    for line in lines_of(summary):
        console.print(line, highlight=False)
    write_figures(
        json_file, {"summary": summary._asdict(), "rows": [row._asdict() for row in rows]}
    )
    return 0 if summary.drives_ok == summary.drives else EXIT_NOT_OK


def sample(tasks: Sequence[Task]) -> list[Task]:
    """One drive of each kind of fault, at speeds in turn, and every 17th under a condition."""
    found: dict[tuple[str, ...], Task] = {}
    speeds_kmh = sorted({task.speed_kmh for task in tasks}, reverse=True)
    for task in tasks:
        kinds = tuple(sorted({str(fault["kind"]) for fault in task.case.faults}))
        is_next = task.speed_kmh == speeds_kmh[len(found) % len(speeds_kmh)]
        if kinds not in found and is_next and not task.case.condition:
            found[kinds] = task
    return [*found.values(), *[task for task in tasks if task.case.condition][::SAMPLE_STRIDE]]


def _drive_all(tasks: Sequence[Task], jobs: int) -> Iterator[MatrixRow]:
    if jobs <= 1:
        yield from map(Task.drive, tasks)
        return
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        yield from pool.map(Task.drive, tasks)


@cache
def _bundle(model: str | None) -> Bundle:
    return load_bundle(find_model(model))


def _earlier(path: Path | None, bundle: Bundle) -> dict[_Key, MatrixRow]:
    """The drives that a file already has.

    Raises:
        ConfigError: they are of another model.
    """
    if path is None or not path.exists():
        return {}
    found = {}
    for line in map(json.loads, read_text(path).splitlines()):
        if line["model"] != bundle.sha256:
            raise ConfigError(
                f"--drives {path}: expected drives of the model {bundle.name}, found those of "
                f"another. Name another file, or the same model."
            )
        row = MatrixRow(**{**line["row"], "reasons": tuple(line["row"]["reasons"])})
        found[row.fault, row.condition, row.speed_mps] = row
    return found


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
