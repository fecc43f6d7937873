"""Times and accuracy of every solver on a recording, in several rounds."""

import time
from collections.abc import Iterator, Sequence
from math import inf
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import qpsolvers

from benchmarks.peers.recording import Matrices, Recording
from benchmarks.peers.solvers import COLD, DEFAULT, TOLERANCES, SolverEntry, one_sided_problem
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import N_INPUTS
from rt_controller.control.program import SolveStatus
from rt_controller.report.table import Cell, Column, Row, Table, format_number

KKT_TOLERANCE = 1e-7
"""of the primal and dual residual and of the duality gap"""
ACCEPTED_ERROR = 1e-4
"""of the first input, as a share of its range"""
_OVER = {"cold": COLD, "default": DEFAULT}
HEADS = {
    "p50 and p99": {
        "p50_us": Column("p50", "us"),
        "p99_us": Column("p99", "us"),
        "p50_us_over_cold": Column("p50", "/ cold"),
        "p99_us_over_cold": Column("p99", "/ cold"),
        "p50_us_over_default": Column("p50", "/ default"),
    },
    "accuracy and longest time": {
        "first_input_error": Column("u_0 error"),
        "unsolved": Column("unsolved"),
        "max_us": Column("max", "us"),
    },
}
"""two narrow tables fit into a terminal; one with all columns does not"""


class UncertainError(Exception):
    """A solution could not be certified."""


class SolverRun(NamedTuple):
    """Times and first inputs of one solver on one recording."""

    times_us: Array
    """(ticks,)"""
    first_inputs: Array
    """(ticks, 3), in units of their ranges"""
    unsolved: int

    def error(self, exact: Array) -> float:
        """Largest error of all ticks and inputs, as a share of the input's range."""
        return float(np.abs(self.first_inputs - exact).max())


def exact_first_inputs(recording: Recording) -> Array:
    """First inputs (ticks, 3) of every problem that is no warm-up.

    Raises:
        UncertainError: a solution does not meet the optimality conditions to 1e-7.
    """
    program = recording.program.copy()
    first_inputs: list[Array] = []
    for event in recording.replay(program):
        if isinstance(event, Matrices) or event.is_warm_up:
            continue
        problem = one_sided_problem(program)
        exact = qpsolvers.solve_problem(problem, "daqp", primal_tol=1e-10, dual_tol=1e-12)
        if not exact.is_optimal(KKT_TOLERANCE):
            raise UncertainError(
                f"{recording.model}, {recording.scenario}, problem {len(first_inputs)}: expected a "
                f"solution that meets the optimality conditions within {KKT_TOLERANCE:g}, found "
                f"residuals {exact.primal_residual():.3g} and {exact.dual_residual():.3g}."
            )
        first_inputs.append(exact.x[:N_INPUTS].copy())
    return np.array(first_inputs)


def run_solver(
    entry: SolverEntry, tolerance: float, recording: Recording, max_unsolved: float = inf
) -> SolverRun:
    """All problems once, or until more than `max_unsolved` are unsolved.

    New matrices, and the problem at the predicted state, are not timed, as in the controller.
    """
    program = recording.program.copy()
    solver = entry.open(program, tolerance)
    times_us: list[float] = []
    first_inputs: list[Array] = []
    unsolved = 0
    for event in recording.replay(program):
        if isinstance(event, Matrices):
            solver.update_matrices()
            continue
        begun_ns = time.perf_counter_ns()
        status = solver.solve()
        spent_us = (time.perf_counter_ns() - begun_ns) / 1e3
        if event.is_warm_up:
            continue
        times_us.append(spent_us)
        unsolved += status is not SolveStatus.SOLVED
        first_inputs.append(solver.solution[:N_INPUTS].copy())
        if unsolved > max_unsolved:
            break
    return SolverRun(np.array(times_us), np.array(first_inputs), unsolved)


def find_tolerance(entry: SolverEntry, recording: Recording, exact: Array) -> float | None:
    """Loosest tolerance that solves every problem accurately; None if there is none."""
    for tolerance in TOLERANCES if entry.has_tolerance else TOLERANCES[:1]:
        run = run_solver(entry, tolerance, recording, max_unsolved=0)
        if run.unsolved == 0 and run.error(exact) <= ACCEPTED_ERROR:
            return tolerance
    return None


def compare(
    recording: Recording, entries: Sequence[SolverEntry], rounds: int
) -> dict[str, dict[str, Any]]:
    """Figures of each solver by its name, with the loosest tolerance that is accurate.

    A solver is accurate if with some tolerance it solves every problem with a first input within
    1e-4 of its range. The fastest is first.
    """
    exact = exact_first_inputs(recording)
    tolerances = {entry.name: find_tolerance(entry, recording, exact) for entry in entries}
    rows = []
    rng = np.random.default_rng(0)
    for round_ in range(rounds):
        for entry in (entries[index] for index in rng.permutation(len(entries))):
            run = run_solver(entry, tolerances[entry.name] or 1e-6, recording)
            times_us = np.percentile(run.times_us, (50, 99, 100), method="higher")
            rows.append((round_, entry.name, *times_us, run.error(exact), run.unsolved))
    names = ["round", "name", "p50_us", "p99_us", "max_us", "first_input_error", "unsolved"]
    figures = summarise(pd.DataFrame(rows, columns=names))
    for entry in entries:
        accepted = tolerances[entry.name]
        figures[entry.name]["is_accurate"] = accepted is not None
        figures[entry.name]["tolerance"] = str(accepted or "none") if entry.has_tolerance else ""
    return figures


def summarise(rounds: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """By `name`: medians over the rounds, the worst accuracy, and ratios to the own solvers.

    A ratio is taken within a round: a slow round of the machine changes both figures. It has the
    median, the smallest and the largest of all rounds.
    """
    figures = rounds.set_index(["round", "name"])
    by_name = figures.groupby("name", sort=False)
    summary = by_name.median().assign(**by_name[["first_input_error", "unsolved"]].max())
    found = summary.sort_values("p50_us").to_dict("index")
    for label, reference in _OVER.items():
        others = figures[["p50_us", "p99_us"]].xs(reference, level="name")
        ratios = figures[["p50_us", "p99_us"]].div(others, level="round")
        for (name, figure), values in ratios.stack().groupby(level=[1, 2]):
            parts = {"median": values.median(), "least": values.min(), "most": values.max()}
            found[name][f"{figure}_over_{label}"] = parts
    return {str(name): each for name, each in found.items()}


def tables_of(title: str, figures: dict[str, dict[str, Any]]) -> Iterator[Table]:
    """A table for each of `HEADS`."""
    for subject, columns in HEADS.items():
        rows: list[Row] = [
            (name, *(_cell(x[key]) for key in columns)) for name, x in figures.items()
        ]
        heads = (Column("name", is_text=True), *columns.values())
        yield Table(f"{title}: {subject}", heads, tuple(rows))


def _cell(x: Any) -> Cell:
    if isinstance(x, dict):
        median, least, most = (f"{y:.2f}" if y < 10 else format_number(y, 3) for y in x.values())
        return Cell(median, f"{least}–{most}")
    return Cell(format_number(float(x), 3))
