"""PIQP, with and without its first try, and DAQP: two methods, one answer."""

import numpy as np
import pytest

pytest.importorskip("daqp", reason="the extra [daqp] is not installed")
pytest.importorskip("benchmarks", reason="this is no checkout")

from random_problems import COST, HORIZON, TIERS, aim, random_bundle

from benchmarks.peers.recording import Matrices, record
from benchmarks.peers.tiers import TIERS as RECORDED_TIERS
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.control.program import QuadraticProgram
from rt_controller.control.qp import CondensedQp
from rt_controller.control.solver import Solver, SolveStatus
from rt_controller.control.solvers import SolverChoice, open_solver

ENOUGH = 1e-4
"""of its range: how far two answers of the first input may be apart"""
MANY = pytest.param(5_000, marks=pytest.mark.nightly)


def everybody(program: QuadraticProgram) -> list[Solver]:
    """All around the same memory."""
    return [
        open_solver(program),
        open_solver(program, warm_start=False),
        open_solver(program, SolverChoice.DAQP),
    ]


def require_agreement(solvers: list[Solver], number: int) -> None:
    statuses = [solver.solve() for solver in solvers]
    assert statuses == [SolveStatus.SOLVED] * len(solvers), number
    inputs = np.array([solver.solution[:3] for solver in solvers])
    assert np.ptp(inputs, axis=0).max() < ENOUGH, number


@pytest.mark.parametrize("problems", [300, MANY])
def test_all_solvers_agree_on_random_problems(problems: int) -> None:
    """Jumping from anywhere to anywhere: nothing of the last problem helps with the next."""
    tiers = list(TIERS.values())
    for number in range(0, problems, 25):
        rng = np.random.default_rng(number)
        rank = (0, 1, 4)[number // 25 % 3]
        qp = CondensedQp(
            random_bundle(rng, rank), HORIZON, COST, INPUT_LIMITS, tiers[number // 75 % len(tiers)]
        )
        solvers = everybody(qp.program)
        for more in range(25):
            aim(qp, rng)
            assert all(solver.renew() for solver in solvers)
            require_agreement(solvers, number + more)


@pytest.mark.parametrize("problems", [300, MANY])
def test_all_solvers_agree_on_recorded_problems(problems: int) -> None:
    number = 0
    while number < problems:
        for model in ("mdk-net", "mdk-net-paper"):
            for tier in RECORDED_TIERS.values():
                recording = record(model, "double_lane_change", tier)
                program = recording.copy()
                solvers = everybody(program)
                for event in recording.replay(program):
                    if number == problems:
                        return
                    if isinstance(event, Matrices):
                        assert all(solver.renew() for solver in solvers)
                    else:
                        require_agreement(solvers, number)
                        number += 1
