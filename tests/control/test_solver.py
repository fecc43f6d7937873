"""The solver says how it ended, and an unfinished solve is used only if it is as good as done."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.control.constraints import InputConstraints
from rt_controller.control.objective import Situation
from rt_controller.control.solver import PiqpWorkspace, SolveStatus

NV = 30
BOX = InputConstraints(
    D=np.eye(NV) - np.eye(NV, k=-3),
    slew=np.full(NV, 0.1),
    scale=np.tile(np.array(INPUT_LIMITS.upper) - np.array(INPUT_LIMITS.lower), 10),
    lower=np.zeros(NV),
    upper=np.ones(NV),
)


def convex(seed: int) -> np.ndarray:
    M = np.random.default_rng(seed).normal(size=(NV, NV))
    return M @ M.T / NV + 0.1 * np.eye(NV)


def sloping(seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=NV)


@dataclass(slots=True)
class GivenObjective:
    """Aimed by writing into it."""

    H: np.ndarray = field(default_factory=lambda: convex(7))
    gradient: np.ndarray = field(default_factory=lambda: np.zeros(NV))
    renews_hessian: bool = False

    def aim(self, situation: Situation) -> None:
        raise NotImplementedError


def solve(workspace: PiqpWorkspace) -> SolveStatus:
    return workspace.solve(-BOX.slew, BOX.slew, BOX.upper)


def assert_optimal(v: np.ndarray, objective: GivenObjective) -> None:
    def cost(inputs: np.ndarray) -> float:
        return float(0.5 * inputs @ objective.H @ inputs + objective.gradient @ inputs)

    rng = np.random.default_rng(2)
    for _ in range(50):
        walk = np.zeros((11, 3))
        for k in range(10):
            walk[k + 1] = np.clip(walk[k] + rng.uniform(-0.1, 0.1, size=3), 0.0, 1.0)
        towards = walk[1:].reshape(-1) - v  # a convex set: all of the way is feasible
        assert all(cost(v + part * towards) >= cost(v) - 1e-7 for part in (0.01, 0.1, 1.0))


def test_a_solution_meets_the_optimality_conditions() -> None:
    objective = GivenObjective(gradient=sloping())
    workspace = PiqpWorkspace(objective, BOX)
    assert solve(workspace) is SolveStatus.SOLVED
    assert_optimal(workspace.solution, objective)
    assert workspace.iterations > 0
    assert workspace.solve_ns > 0


def test_a_solve_cut_short_far_from_the_optimum_is_not_used() -> None:
    workspace = PiqpWorkspace(GivenObjective(gradient=sloping()), BOX, max_iterations=2)
    assert solve(workspace) is SolveStatus.ITERATION_LIMIT


def test_a_solve_cut_short_close_to_the_optimum_is_used() -> None:
    objective = GivenObjective(gradient=sloping())
    exact = PiqpWorkspace(objective, BOX)
    solve(exact)
    short = PiqpWorkspace(objective, BOX, max_iterations=exact.iterations - 1)
    assert solve(short) is SolveStatus.SOLVED
    np.testing.assert_allclose(short.solution, exact.solution, atol=1e-3)


def test_bounds_that_contradict_each_other_are_never_solved() -> None:
    workspace = PiqpWorkspace(GivenObjective(), BOX)
    slew_lower = BOX.slew.copy()
    slew_lower[:3] = 0.5
    status = workspace.solve(slew_lower, np.full(NV, 0.6), np.full(NV, 0.1))
    assert status in {SolveStatus.INFEASIBLE, SolveStatus.ITERATION_LIMIT}


@pytest.mark.parametrize("poison", [np.nan, np.inf])
def test_a_gradient_that_is_not_a_number_is_never_solved(poison: float) -> None:
    objective = GivenObjective()
    workspace = PiqpWorkspace(objective, BOX)
    objective.gradient[4] = poison
    assert solve(workspace) is SolveStatus.NUMERICS
    # and the workspace is not poisoned by it
    objective.gradient[:] = sloping()
    assert solve(workspace) is SolveStatus.SOLVED


def test_a_new_hessian_is_the_one_that_is_minimised() -> None:
    """Also where it is far from the one that the problem was scaled for at start."""
    objective = GivenObjective(gradient=sloping(), renews_hessian=True)
    workspace = PiqpWorkspace(objective, BOX)
    ranges = np.geomspace(0.03, 30.0, NV)
    for seed in range(20):
        objective.H[:] = convex(seed) * ranges * ranges[:, None]
        ranges = np.roll(ranges, 7)
        assert solve(workspace) is SolveStatus.SOLVED
        fresh = PiqpWorkspace(objective, BOX)
        solve(fresh)
        np.testing.assert_allclose(workspace.solution, fresh.solution, rtol=0.0, atol=1e-4)
        assert_optimal(workspace.solution, objective)


def test_a_zero_of_the_first_hessian_may_become_something_else() -> None:
    objective = GivenObjective(H=np.eye(NV), gradient=sloping(), renews_hessian=True)
    workspace = PiqpWorkspace(objective, BOX)
    objective.H[:] = convex(3)
    assert solve(workspace) is SolveStatus.SOLVED
    assert_optimal(workspace.solution, objective)


def indefinite() -> np.ndarray:
    H = convex(7)
    return H - 2.0 * np.linalg.eigvalsh(H)[-1] * np.eye(NV)


def with_entry(value: float) -> np.ndarray:
    H = convex(7)
    H[4, 9] = H[9, 4] = value
    return H


@pytest.mark.parametrize(
    "broken",
    [with_entry(np.nan), with_entry(np.inf), indefinite(), with_entry(1e3), with_entry(1e300)],
)
def test_a_hessian_that_is_not_convex_is_a_status_and_leaves_no_trace(broken: np.ndarray) -> None:
    objective = GivenObjective(gradient=sloping(), renews_hessian=True)
    workspace = PiqpWorkspace(objective, BOX)
    assert solve(workspace) is SolveStatus.SOLVED
    expected = workspace.solution.copy()
    objective.H[:] = broken
    assert solve(workspace) is not SolveStatus.SOLVED
    assert np.isfinite(broken).all() or workspace.iterations == 0  # not even tried
    objective.H[:] = convex(7)
    assert solve(workspace) is SolveStatus.SOLVED
    np.testing.assert_allclose(workspace.solution, expected, rtol=0.0, atol=1e-6)
