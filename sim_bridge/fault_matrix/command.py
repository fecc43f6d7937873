"""`sim-bridge fault-matrix`: every fault at every speed, as a table and as JSON."""

import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from functools import cache
from multiprocessing import get_context
from pathlib import Path

from rich.console import Console

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.model.artifact import find_model, load_bundle
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.names import hint
from rt_controller.report.table import NO_VALUE, Cell, Column, Table, print_table
from rt_controller.terminal.progress import announce
from sim_bridge.fault_matrix.cases import SPEEDS_KMH, Case, load_cases
from sim_bridge.fault_matrix.drive import drive_case
from sim_bridge.fault_matrix.row import MatrixRow, row_of
from sim_bridge.fault_matrix.summary import lines_of, summarise
from sim_bridge.scenario.limits import KMH_PER_MPS

EXIT_NOT_OK = 1
_LEAST_WIDTH = 140


def fault_matrix(
    model: str | None,
    only: Sequence[str],
    speeds_kmh: Sequence[float],
    jobs: int | None,
    json_file: Path | None,
    cases_file: Path | None = None,
) -> int:
    """Drive all faults, or those of a file, at all speeds and print the rows; 1 if one is not ok.

    Raises:
        ConfigError: unknown faults, or a file that cannot be written.
        ArtifactError: the model cannot be used.
    """
    require_writable(json_file)
    cases = _chosen(only, cases_file)
    _bundle(model)  # refused here, not in a process
    tasks = [(case, speed, model) for case in cases for speed in speeds_kmh or SPEEDS_KMH]
    jobs = min(jobs or _cores(), len(tasks))
    with announce(f"{len(tasks)} drives, {jobs} at a time"):
        rows = list(_drive_all(tasks, jobs))
    console = Console()
    console.width = max(console.width, _LEAST_WIDTH)
    print_table(_table(rows), console)
    summary = summarise(rows)
    for line in lines_of(summary):
        console.print(line, highlight=False)
    write_figures(json_file, {"summary": asdict(summary), "rows": [asdict(row) for row in rows]})
    return 0 if summary.drives_ok == summary.drives else EXIT_NOT_OK


_Task = tuple[Case, float, str | None]


def _drive_all(tasks: Sequence[_Task], jobs: int) -> Iterator[MatrixRow]:
    if jobs <= 1:
        yield from map(_drive, tasks)
        return
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        yield from pool.map(_drive, tasks)


def _drive(task: _Task) -> MatrixRow:
    case, speed_kmh, model = task
    return row_of(case, speed_kmh, drive_case(case, speed_kmh, _bundle(model)))


@cache
def _bundle(model: str | None) -> Bundle:
    return load_bundle(find_model(model))


def _cores() -> int:
    return len(os.sched_getaffinity(0))


def _chosen(only: Sequence[str], file: Path | None) -> Sequence[Case]:
    cases = {case.name: case for case in load_cases(file)}
    unknown = [f"{name!r}{hint(name, cases)}" for name in only if name not in cases]
    if unknown:
        raise ConfigError(
            f"--only: expected names of faults, found {', '.join(unknown)}. "
            f"{file or 'sim_bridge/fault_matrix/cases.toml'} has all."
        )
    return [cases[name] for name in only] if only else list(cases.values())


def _table(rows: Iterable[MatrixRow]) -> Table:
    columns = (
        Column("fault", is_text=True),
        Column("speed", "km/h"),
        Column("mode", is_text=True),
        Column("detected", "ms"),
        Column("max |e_y|", "m"),
        Column("ok", is_text=True),
        Column("reasons", is_text=True, width="long"),
    )
    return Table(
        "faults in simulated time",
        columns,
        tuple(
            (
                row.fault,
                f"{row.speed_mps * KMH_PER_MPS:.0f}",
                row.mode,
                NO_VALUE if row.detect_ms is None else f"{row.detect_ms:.0f}",
                f"{row.max_ey_m:.2f}",
                Cell("ok", status="good") if row.ok else Cell("NO", status="bad"),
                "; ".join((*row.reasons, *filter(None, (row.known_limit,)))),
            )
            for row in rows
        ),
    )
