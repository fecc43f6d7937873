"""PIQP, with and without warm start, and DAQP find the same solutions."""

import numpy as np
import pytest

pytest.importorskip("daqp", reason="the extra [daqp] is not installed")
pytest.importorskip("benchmarks", reason="the benchmarks are not part of the installed package")

from random_problems import COST, HORIZON, TIERS, random_bundle, update_vectors
from virtual_drive import SHORT_LANE_CHANGE

from benchmarks.peers.recording import TIERS as RECORDED_TIERS
from benchmarks.peers.recording import Matrices, record
from rt_controller.control.piqp_solver import PiqpSolver
from rt_controller.control.program import QuadraticProgram
from rt_controller.control.qp import CondensedQp
from rt_controller.control.solver import Solver, SolveStatus, open_solver
from rt_controller.control.warm_start import WarmStartedSolver

MAX_DIFFERENCE = 1e-4
"""of two solutions' first inputs, as a share of the range"""
PATIENT_ITERATIONS = 50


def open_all(program: QuadraticProgram) -> list[Solver]:
    return [
        open_solver(program),
        open_solver(program, warm_start=False),
        open_solver(program, "daqp"),
    ]


def open_patient(program: QuadraticProgram) -> list[Solver]:
    """The same with more iterations for PIQP, whose limit keeps a control period."""
    piqp, cold = (PiqpSolver(program, PATIENT_ITERATIONS) for _ in range(2))
    return [WarmStartedSolver(program, piqp), cold, open_solver(program, "daqp")]


def assert_same_first_input(solvers: list[Solver]) -> None:
    statuses = [solver.solve() for solver in solvers]
    assert statuses == [SolveStatus.SOLVED] * len(solvers)
    inputs = np.array([solver.solution[:3] for solver in solvers])
    assert np.ptp(inputs, axis=0).max() < MAX_DIFFERENCE


@pytest.mark.parametrize("problems", [300, pytest.param(5_000, marks=pytest.mark.nightly)])
def test_all_solvers_agree_on_random_problems(problems: int) -> None:
    """Consecutive problems are independent, so no warm start helps.

    Of 5,000 such problems 24 need more iterations than PIQP has in a control period.
    """
    tiers = list(TIERS.values())
    for number in range(problems // 25):
        rng = np.random.default_rng(25 * number)
        bundle = random_bundle(rng, rank=(0, 1, 4)[number % 3])
        features = tiers[number // 3 % len(tiers)]
        qp = CondensedQp(bundle, HORIZON, COST, features)
        solvers = open_patient(qp.program)
        for _ in range(25):
            update_vectors(qp, rng)
            assert all(solver.update_matrices() for solver in solvers)
            assert_same_first_input(solvers)


@pytest.mark.parametrize(
    "scenario",
    [SHORT_LANE_CHANGE, pytest.param("double_lane_change", marks=pytest.mark.nightly)],
    ids=["short", "whole"],
)
@pytest.mark.parametrize("features", RECORDED_TIERS.values(), ids=RECORDED_TIERS.keys())
@pytest.mark.parametrize("model", ["mdk-net", "mdk-net-paper"])
def test_all_solvers_agree_on_recorded_problems(model: str, features, scenario: str) -> None:
    recording = record(model, scenario, features)
    program = recording.program.copy()
    solvers = open_all(program)
    for event in recording.replay(program):
        if isinstance(event, Matrices):
            assert all(solver.update_matrices() for solver in solvers)
        else:
            assert_same_first_input(solvers)
