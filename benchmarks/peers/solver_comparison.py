"""Times and accuracy of every solver on a recording, in several rounds."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from math import inf

import numpy as np
import pandas as pd
import qpsolvers

from benchmarks.peers.recording import Matrices, Recording
from benchmarks.peers.solvers.registry import COLD, DEFAULT, TOLERANCES, SolverEntry
from benchmarks.tables import percentiles, summarise, timed
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import N_INPUTS
from rt_controller.control.program import SolveStatus
from rt_controller.report.table import Column

KKT_TOLERANCE = 1e-7
"""of the primal and dual residual and of the duality gap"""
ACCEPTED_ERROR = 1e-4
"""of the first input, as a share of its range"""


class UncertainError(Exception):
    """A solution could not be certified."""


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
        rows = np.vstack([program.G, -program.G])
        limits = np.concatenate([program.row_upper, -program.row_lower])
        constraints = (rows, limits) if len(rows) else (None, None)
        problem = qpsolvers.Problem(
            program.P, program.q, *constraints, lb=program.lower, ub=program.upper
        )
        exact = qpsolvers.solve_problem(problem, "daqp", primal_tol=1e-10, dual_tol=1e-12)
        if not exact.is_optimal(KKT_TOLERANCE):
            raise UncertainError(
                f"{recording.model}, {recording.scenario}, problem {len(first_inputs)}: expected a "
                f"solution that meets the optimality conditions within {KKT_TOLERANCE:g}, found "
                f"residuals {exact.primal_residual():.3g} and {exact.dual_residual():.3g}."
            )
        first_inputs.append(exact.x[:N_INPUTS].copy())
    return np.array(first_inputs)


class Mode(StrEnum):
    """What the solver is given before the clock starts."""

    PREPARED = "prepared"
    """the matrices, and the problem at the predicted state, as in the controller"""
    UNPREPARED = "unprepared"
    """nothing: new matrices and the solve are timed together"""


@dataclass(frozen=True)
class SolverRun:
    """Times and first inputs of one solver on one recording."""

    times_us: Array
    """(ticks,)"""
    first_inputs: Array
    """(ticks, 3), in units of their ranges"""
    unsolved: int


def run_solver(
    entry: SolverEntry,
    tolerance: float,
    recording: Recording,
    mode: Mode,
    max_unsolved: float = inf,
) -> SolverRun:
    """All problems once, or until more than `max_unsolved` are unsolved."""
    program = recording.program.copy()
    solver = entry.open(program, tolerance)
    times_us: list[float] = []
    first_inputs: list[Array] = []
    unsolved, matrices_us = 0, 0.0
    for event in recording.replay(program):
        if isinstance(event, Matrices):
            matrices_us = timed(solver.update_matrices)[1]
            continue
        if event.is_warm_up and mode is Mode.UNPREPARED:
            continue
        status, spent_us = timed(solver.solve)
        if event.is_warm_up:
            continue
        times_us.append(spent_us + (matrices_us if mode is Mode.UNPREPARED else 0.0))
        matrices_us = 0.0
        unsolved += status is not SolveStatus.SOLVED
        first_inputs.append(solver.solution[:N_INPUTS].copy())
        if unsolved > max_unsolved:
            break
    return SolverRun(np.array(times_us), np.array(first_inputs), unsolved)


def first_input_error(run: SolverRun, exact: Array) -> float:
    """Largest error of all ticks and inputs, as a share of the input's range."""
    return float(np.abs(run.first_inputs - exact).max())


def find_tolerance(entry: SolverEntry, recording: Recording, exact: Array) -> float | None:
    """Loosest tolerance that solves every problem accurately; None if there is none."""
    for tolerance in TOLERANCES if entry.has_tolerance else TOLERANCES[:1]:
        run = run_solver(entry, tolerance, recording, Mode.PREPARED, max_unsolved=0)
        if run.unsolved == 0 and first_input_error(run, exact) <= ACCEPTED_ERROR:
            return tolerance
    return None


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
        "tolerance": Column("tolerance"),
        "max_us": Column("max", "us"),
    },
}


def compare(
    recording: Recording, entries: Sequence[SolverEntry], mode: Mode, rounds: int
) -> pd.DataFrame:
    """A row for each solver, with the loosest tolerance that is accurate; columns as `HEADS`.

    A solver is accurate if with some tolerance it solves every problem with a first input within
    1e-4 of its range. The fastest is first.
    """
    exact = exact_first_inputs(recording)
    tolerances = {entry.name: find_tolerance(entry, recording, exact) for entry in entries}
    rows = []
    rng = np.random.default_rng(0)
    for round_ in range(rounds):
        for index in rng.permutation(len(entries)):
            entry = entries[index]
            run = run_solver(entry, tolerances[entry.name] or 1e-6, recording, mode)
            rows.append(
                {
                    "round": round_,
                    "name": entry.name,
                    **percentiles(run.times_us),
                    "first_input_error": first_input_error(run, exact),
                    "unsolved": run.unsolved,
                }
            )
    found = pd.DataFrame(rows)
    summary = summarise(found, ("p50_us", "p99_us"), {"cold": COLD, "default": DEFAULT})
    worst = found.groupby("name")[["first_input_error", "unsolved"]].max()
    summary.update(worst)
    summary["is_accurate"] = [tolerances[name] is not None for name in summary.index]
    has_tolerance = {entry.name: entry.has_tolerance for entry in entries}
    summary["tolerance"] = [
        str(tolerances[name] or "none") if has_tolerance[name] else "" for name in summary.index
    ]
    return summary.sort_values("p50_us")
