"""The solver says how it ended, and an unfinished solve is used only if it is as good as done."""

import numpy as np
import pytest

from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.control.qp import CondensedQp
from rt_controller.control.solver import PiqpWorkspace, SolveStatus


@pytest.fixture
def qp() -> CondensedQp:
    rng = np.random.default_rng(7)
    nv = 30
    M = rng.normal(size=(nv, nv))
    range_ = np.array(INPUT_LIMITS.upper) - np.array(INPUT_LIMITS.lower)
    return CondensedQp(
        H=M @ M.T / nv + 0.1 * np.eye(nv),
        gradient_map=np.zeros((nv, 1)),
        D=np.eye(nv) - np.eye(nv, k=-3),
        slew=np.full(nv, 0.1),
        scale=np.tile(range_, 10),
        lower=np.zeros(nv),
        upper=np.ones(nv),
        horizon=10,
        n_observables=6,
        n_outputs=6,
    )


def solve(workspace: PiqpWorkspace, qp: CondensedQp, gradient: np.ndarray) -> SolveStatus:
    return workspace.solve(gradient, -qp.slew, qp.slew, qp.upper)


def test_a_solution_meets_the_optimality_conditions(qp: CondensedQp) -> None:
    workspace = PiqpWorkspace(qp)
    gradient = np.random.default_rng(1).normal(size=30)
    assert solve(workspace, qp, gradient) is SolveStatus.SOLVED
    v = workspace.solution
    cost = 0.5 * v @ qp.H @ v + gradient @ v
    rng = np.random.default_rng(2)
    for _ in range(200):
        other = np.clip(v + 0.02 * rng.normal(size=30), qp.lower, qp.upper)
        if np.all(np.abs(qp.D @ other) <= qp.slew):
            assert 0.5 * other @ qp.H @ other + gradient @ other >= cost - 1e-7
    assert workspace.iterations > 0
    assert workspace.solve_ns > 0


def test_a_solve_cut_short_far_from_the_optimum_is_not_used(qp: CondensedQp) -> None:
    workspace = PiqpWorkspace(qp, max_iterations=2)
    gradient = np.random.default_rng(1).normal(size=30)
    assert solve(workspace, qp, gradient) is SolveStatus.ITERATION_LIMIT


def test_a_solve_cut_short_close_to_the_optimum_is_used(qp: CondensedQp) -> None:
    gradient = np.random.default_rng(1).normal(size=30)
    exact = PiqpWorkspace(qp)
    solve(exact, qp, gradient)
    short = PiqpWorkspace(qp, max_iterations=exact.iterations - 1)
    assert solve(short, qp, gradient) is SolveStatus.SOLVED
    np.testing.assert_allclose(short.solution, exact.solution, atol=1e-3)


def test_bounds_that_contradict_each_other_are_never_solved(qp: CondensedQp) -> None:
    workspace = PiqpWorkspace(qp)
    slew_lower = qp.slew.copy()
    slew_lower[:3] = 0.5
    slew_upper = np.full(30, 0.6)
    status = workspace.solve(np.zeros(30), slew_lower, slew_upper, np.full(30, 0.1))
    assert status in {SolveStatus.INFEASIBLE, SolveStatus.ITERATION_LIMIT}


@pytest.mark.parametrize("poison", [np.nan, np.inf])
def test_a_gradient_that_is_not_a_number_is_never_solved(qp: CondensedQp, poison: float) -> None:
    workspace = PiqpWorkspace(qp)
    gradient = np.zeros(30)
    gradient[4] = poison
    assert solve(workspace, qp, gradient) is not SolveStatus.SOLVED
    # and the workspace is not poisoned by it
    assert solve(workspace, qp, np.random.default_rng(1).normal(size=30)) is SolveStatus.SOLVED
