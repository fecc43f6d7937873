"""One solver through one recording: how long each problem took, and how exact the answers are."""

import time
from dataclasses import dataclass
from enum import StrEnum
from math import inf

import numpy as np

from benchmarks.peers.entrants.roster import TOLERANCES, Entrant
from benchmarks.peers.recording import Matrices, Recording
from rt_controller.contract.bundle import Array
from rt_controller.control.constraints import N_INPUTS
from rt_controller.control.solver import SolveStatus

EXACT_ENOUGH = 1e-4
"""of its range, the error of the first input that a solver may have"""


class Mode(StrEnum):
    """What is known before the tick."""

    PREPARED = "prepared"
    """matrices, and the problem as it is expected: both are given to the solver between the ticks,
    as the controller does; the tick's own problem is timed"""
    UNPREPARED = "unprepared"
    """nothing: new matrices and the solve are timed together"""


@dataclass(frozen=True)
class Lap:
    """One solver, one recording, once."""

    times_us: Array
    """(ticks,)"""
    first_inputs: Array
    """(ticks, 3), in units of their ranges"""
    unsolved: int


def drive_lap(
    entrant: Entrant,
    tolerance: float,
    recording: Recording,
    mode: Mode,
    most_unsolved: float = inf,
) -> Lap:
    """Everything once through, or until too much is unsolved."""
    program = recording.copy()
    solver = entrant.open(program, tolerance)
    times_ns: list[int] = []
    answers: list[Array] = []
    unsolved = owed_ns = 0
    for event in recording.replay(program):
        begun_ns = time.perf_counter_ns()
        if isinstance(event, Matrices):
            solver.renew()
            owed_ns = time.perf_counter_ns() - begun_ns
            continue
        if event.is_rehearsal and mode is Mode.UNPREPARED:
            continue
        begun_ns = time.perf_counter_ns()
        status = solver.solve()
        spent_ns = time.perf_counter_ns() - begun_ns
        if event.is_rehearsal:
            continue
        times_ns.append(spent_ns + (owed_ns if mode is Mode.UNPREPARED else 0))
        owed_ns = 0
        unsolved += status is not SolveStatus.SOLVED
        answers.append(solver.solution[:N_INPUTS].copy())
        if unsolved > most_unsolved:
            break
    return Lap(np.array(times_ns) / 1e3, np.array(answers), unsolved)


def first_input_error(lap: Lap, exact: Array) -> float:
    """The worst of all ticks and inputs, as a share of the input's range."""
    return float(np.abs(lap.first_inputs - exact).max())


def find_tolerance(entrant: Entrant, recording: Recording, exact: Array) -> float | None:
    """The loosest at which every problem is solved exactly enough; None if there is none."""
    for tolerance in TOLERANCES if entrant.has_tolerance else TOLERANCES[:1]:
        lap = drive_lap(entrant, tolerance, recording, Mode.PREPARED, most_unsolved=0)
        if lap.unsolved == 0 and first_input_error(lap, exact) <= EXACT_ENOUGH:
            return tolerance
    return None
