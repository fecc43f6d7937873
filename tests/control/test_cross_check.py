"""The warm start from the last active set and PIQP find the same solutions."""

import numpy as np
import pytest

pytest.importorskip("benchmarks", reason="the benchmarks are not part of the installed package")

from random_problems import COST, HORIZON, TIERS, open_precise, random_bundle, update_vectors
from virtual_drive import SHORT_LANE_CHANGE

from benchmarks.peers.recording import TIERS as RECORDED_TIERS
from benchmarks.peers.recording import Matrices, record
from rt_controller.control.program import QuadraticProgram, Solver, SolveStatus
from rt_controller.control.qp import CondensedQp
from rt_controller.control.warm_start import WarmStartedSolver

MAX_DIFFERENCE = 1e-4
"""of two solutions' first inputs, as a share of the range"""


def open_both(program: QuadraticProgram) -> list[Solver]:
    """With and without warm start; PIQP with tolerances that leave no error where costs are flat.

    Its iterations are not limited by a control period.
    """
    return [WarmStartedSolver(program, open_precise(program)), open_precise(program)]


def assert_same_first_input(solvers: list[Solver]) -> None:
    statuses = [solver.solve() for solver in solvers]
    assert statuses == [SolveStatus.SOLVED] * len(solvers)
    inputs = np.array([solver.solution[:3] for solver in solvers])
    assert np.ptp(inputs, axis=0).max() < MAX_DIFFERENCE


@pytest.mark.parametrize("problems", [300, pytest.param(5_000, marks=pytest.mark.nightly)])
def test_warm_start_and_piqp_agree_on_random_problems(problems: int) -> None:
    """Consecutive problems are independent, so no warm start helps."""
    tiers = list(TIERS.values())
    for number in range(problems // 25):
        rng = np.random.default_rng(25 * number)
        bundle = random_bundle(rng, rank=(0, 1, 4)[number % 3])
        corridor = tiers[number // 3 % len(tiers)]
        qp = CondensedQp(bundle, HORIZON, COST, corridor)
        solvers = open_both(qp.program)
        for _ in range(25):
            update_vectors(qp, rng)
            assert all(solver.update_matrices() for solver in solvers)
            assert_same_first_input(solvers)


@pytest.mark.parametrize(
    "scenario",
    [SHORT_LANE_CHANGE, pytest.param("double_lane_change", marks=pytest.mark.nightly)],
    ids=["short", "whole"],
)
@pytest.mark.parametrize("corridor", RECORDED_TIERS.values(), ids=RECORDED_TIERS.keys())
@pytest.mark.parametrize("model", ["mdk-net", "mdk-net-paper"])
def test_warm_start_and_piqp_agree_on_recorded_problems(
    model: str, corridor, scenario: str
) -> None:
    recording = record(model, scenario, corridor)
    program = recording.program.copy()
    solvers = open_both(program)
    for event in recording.replay(program):
        if isinstance(event, Matrices):
            assert all(solver.update_matrices() for solver in solvers)
        else:
            assert_same_first_input(solvers)
