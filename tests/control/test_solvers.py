"""Solutions meet the optimality conditions; warm start and PIQP agree; failures are statuses."""

import numpy as np
import piqp
import pytest
from random_problems import COST, HORIZON, TIERS, open_precise, random_bundle, update_vectors
from virtual_drive import SHORT_LANE_CHANGE

from rt_controller.contract.errors import ConfigError
from rt_controller.control.eq14 import CondensedQp
from rt_controller.control.piqp_solver import PiqpSolver
from rt_controller.control.program import QuadraticProgram, SolveStatus
from rt_controller.control.warm_start import ActiveSetIteration, WarmStartedSolver

NV = 30
SLEW = 0.1
SOLVERS = {
    "piqp": PiqpSolver,
    "warm": lambda program: WarmStartedSolver(program, PiqpSolver(program)),
}
every_solver = pytest.mark.parametrize("open_solver", SOLVERS.values(), ids=SOLVERS.keys())
REFUSED = {SolveStatus.INFEASIBLE, SolveStatus.ITERATION_LIMIT, SolveStatus.NUMERICS}


def convex(rng, size=NV):
    M = rng.normal(size=(size, size))
    return M @ M.T / size + 0.1 * np.eye(size)


def make_program(seed=7, varies=False, slewed=True, slacks=0):
    """Inputs between 0 and 1 that change by at most 0.1, and rows with slacks."""
    rng = np.random.default_rng(seed)
    n, slews = NV + slacks, NV if slewed else 0
    P = np.eye(n)
    P[:NV, :NV] = convex(rng)
    D = np.eye(NV) - np.eye(NV, k=-3)
    G = np.zeros((slews + slacks, n))
    G[:slews, :NV] = D[:slews]
    pattern = G != 0.0
    G[slews:, :NV] = 0.3 * rng.normal(size=(slacks, NV))
    G[slews:, NV:] = np.eye(slacks)
    pattern[slews:] = True
    program = QuadraticProgram(P, rng.normal(size=n), G, pattern, varies, varies and slacks > 0)
    program.lower[:NV], program.upper[:NV] = 0.0, 1.0
    program.row_lower[:slews], program.row_upper[:slews] = -SLEW, SLEW
    program.row_lower[slews:], program.row_upper[slews:] = -0.05, 0.05
    return program


def change(program, rng, size=0.1):
    """Change the program a little, as from one period to the next."""
    program.q[:NV] += size * rng.normal(size=NV)
    if program.hessian_varies:
        program.P[:NV, :NV] += 0.1 * size * convex(rng)
    if program.rows_vary:
        slacks = program.size - NV
        program.G[-slacks:, :NV] += size * rng.normal(size=(slacks, NV))


def assert_optimal(z, program, atol=2e-5):
    """KKT conditions: z is feasible, and the gradient is a sum of normals of active bounds."""
    values = np.concatenate([z, program.G @ z])
    assert np.all(values <= program.all_upper + atol)
    assert np.all(values >= program.all_lower - atol)
    gradient = program.P @ z + program.q
    rows = np.vstack([np.eye(program.size), program.G])
    near = 30 * atol
    at_upper, at_lower = values > program.all_upper - near, values < program.all_lower + near
    normals = np.vstack([-rows[at_upper], rows[at_lower]]).T
    from scipy.optimize import nnls

    _, left = nnls(normals, gradient)
    assert left < 1e-3 * max(1.0, float(np.abs(gradient).max()))


PROGRAMS = {
    "box": {"slewed": False},
    "slew": {},
    "slacks": {"slacks": 8},
    "new matrices": {"varies": True},
    "new matrices and rows": {"varies": True, "slacks": 8},
}


@every_solver
@pytest.mark.parametrize("shape", PROGRAMS.values(), ids=PROGRAMS.keys())
def test_solutions_of_changing_programs_meet_the_optimality_conditions(open_solver, shape):
    program, rng = make_program(**shape), np.random.default_rng(1)
    solver = open_solver(program)
    for size in (0.0, 0.01, 0.1, 0.1, 0.1, 3.0, 0.01):
        change(program, rng, size)
        assert solver.update_matrices()
        assert solver.solve() is SolveStatus.SOLVED
        assert solver.iterations > 0
        assert_optimal(solver.solution, program)


def contradict(program):
    program.row_lower[:3], program.row_upper[:3] = 0.5, 0.6
    program.upper[:3] = 0.1


def cross_bounds(program):
    program.upper[4] = -0.5


def turn_concave(program, size=2.0):
    program.P[:] -= size * np.linalg.eigvalsh(program.P)[-1] * np.eye(NV)


def turn_very_concave(program):
    turn_concave(program, 1e3)


@every_solver
@pytest.mark.parametrize("spoil", [contradict, cross_bounds, turn_concave, turn_very_concave])
def test_a_program_without_a_solution_is_a_status_and_does_not_affect_the_next_solve(
    open_solver, spoil
):
    program = make_program(varies=True)
    solver = open_solver(program)
    assert solver.solve() is SolveStatus.SOLVED
    names = ("P", "upper", "row_lower", "row_upper")
    expected, kept = solver.solution.copy(), {name: getattr(program, name).copy() for name in names}
    spoil(program)
    solver.update_matrices()
    assert solver.solve() in REFUSED
    for name, values in kept.items():
        getattr(program, name)[:] = values
    assert solver.update_matrices()
    assert solver.solve() is SolveStatus.SOLVED
    np.testing.assert_allclose(solver.solution, expected, atol=1e-4)


@every_solver
@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("where", ["q", "P", "G", "upper"])
def test_non_finite_values_are_not_solved_and_do_not_affect_the_next_solve(open_solver, bad, where):
    if where == "upper" and bad == np.inf:
        bad = np.nan  # infinite bounds are valid
    program = make_program(varies=True, slacks=4)
    solver = open_solver(program)
    assert solver.solve() is SolveStatus.SOLVED
    expected = solver.solution.copy()
    array = getattr(program, where)
    place = (4,) if array.ndim == 1 else (-1, 4)
    kept = array[place]
    array[place] = bad
    if where == "P":
        program.P[4, -1] = bad
    assert solver.update_matrices() is (where not in ("P", "G"))
    assert solver.solve() is SolveStatus.NUMERICS
    assert solver.iterations == 0
    array[place] = kept
    if where == "P":
        program.P[4, -1] = kept
    assert solver.update_matrices()
    assert solver.solve() is SolveStatus.SOLVED
    np.testing.assert_allclose(solver.solution, expected, atol=1e-4)


@every_solver
def test_a_new_hessian_replaces_the_last_one(open_solver):
    """Also where it is far from the Hessian that PIQP computed its scaling from."""
    program = make_program(varies=True)
    solver, rng = open_solver(program), np.random.default_rng(2)
    ranges = np.geomspace(0.1, 10.0, NV)
    for _ in range(10):
        program.P[:] = convex(rng) * ranges * ranges[:, None]
        ranges = np.roll(ranges, 7)
        assert solver.update_matrices()
        assert solver.solve() is SolveStatus.SOLVED
        assert_optimal(solver.solution, program)


def test_a_solve_stopped_far_from_the_optimum_is_not_solved():
    assert PiqpSolver(make_program(), max_iterations=2).solve() is SolveStatus.ITERATION_LIMIT


def give_durations(monkeypatch, durations_ns):
    times_ns = iter([t for d in durations_ns for t in (0, d)])
    monkeypatch.setattr("time.perf_counter_ns", lambda: next(times_ns))


@pytest.mark.parametrize(("fast_ns", "is_accepted"), [(50_000, True), (5_000_000, False)])
def test_the_budget_is_judged_by_the_fastest_solve(monkeypatch, fast_ns, is_accepted):
    """On a busy machine the other solves say how busy it is."""
    solver = PiqpSolver(make_program())
    give_durations(monkeypatch, [fast_ns if i == 17 else 80_000_000 for i in range(21)])
    if is_accepted:
        solver.limit_solve_time(5_000_000)
        assert solver._workspace.settings.max_iter == 12
    else:
        with pytest.raises(ConfigError, match=r"at least 12 iterations of PIQP.*may be busy"):
            solver.limit_solve_time(5_000_000)


def test_the_iterations_that_fit_are_those_of_the_median_solve(monkeypatch):
    solver = PiqpSolver(make_program())
    solver.solve()
    usual_ns = round(5e6 / 2.0 / 14.5 * solver.iterations)
    give_durations(monkeypatch, [usual_ns // 10 if i == 17 else usual_ns for i in range(21)])
    solver.limit_solve_time(5_000_000)
    assert solver._workspace.settings.max_iter == 14


def test_a_solve_stopped_close_to_the_optimum_is_solved():
    program = make_program()
    exact = PiqpSolver(program)
    exact.solve()
    short = PiqpSolver(program, max_iterations=exact.iterations)
    settings = short._workspace.settings
    settings.eps_abs = settings.eps_duality_gap_abs = 1e-14  # never reached
    assert short._workspace.solve() == piqp.PIQP_MAX_ITER_REACHED
    assert short.solve() is SolveStatus.SOLVED
    np.testing.assert_allclose(short.solution, exact.solution, atol=1e-4)


@pytest.mark.parametrize("shape", PROGRAMS.values(), ids=PROGRAMS.keys())
def test_a_solution_of_the_active_set_iteration_is_exact(shape):
    program, rng = make_program(**shape), np.random.default_rng(3)
    iteration, reference = ActiveSetIteration(program), open_precise(program)
    succeeded = 0
    for _ in range(60):
        change(program, rng, 0.05)
        assert reference.update_matrices()
        assert iteration.update_matrices()
        assert reference.solve() is SolveStatus.SOLVED
        found = iteration.solve(8)
        if found is None:
            iteration.start_from(*reference.active_bounds())
        else:
            succeeded += 1
            np.testing.assert_allclose(found, reference.solution, atol=1e-5)
            assert_optimal(found, program, atol=1e-7)
    assert succeeded > 20


def test_an_unchanged_program_is_solved_in_one_round():
    program = make_program()
    solver = WarmStartedSolver(program, PiqpSolver(program))
    solver.solve()  # by PIQP
    assert solver.solve() is SolveStatus.SOLVED  # from the bounds that PIQP found active
    expected = solver.solution.copy()
    assert solver.solve() is SolveStatus.SOLVED
    assert solver.iterations == 1
    np.testing.assert_allclose(solver.solution, expected, atol=1e-5)


def test_piqp_solves_what_the_active_set_iteration_does_not_solve_in_its_rounds():
    program, rng = make_program(), np.random.default_rng(4)
    iteration = ActiveSetIteration(program)
    change(program, rng, 3.0)
    assert iteration.solve(1) is None
    assert iteration.rounds == 1
    solver = WarmStartedSolver(program, PiqpSolver(program))
    assert solver.solve() is SolveStatus.SOLVED
    assert_optimal(solver.solution, program)


MAX_DIFFERENCE = 1e-4
"""of two solutions' first inputs, as a share of the range"""


def open_both(program):
    """With and without warm start; PIQP with tolerances that leave no error where costs are flat.

    Its iterations are not limited by a control period.
    """
    return [WarmStartedSolver(program, open_precise(program)), open_precise(program)]


def assert_same_first_input(solvers):
    statuses = [solver.solve() for solver in solvers]
    assert statuses == [SolveStatus.SOLVED] * len(solvers)
    inputs = np.array([solver.solution[:3] for solver in solvers])
    assert np.ptp(inputs, axis=0).max() < MAX_DIFFERENCE


@pytest.mark.parametrize("problems", [300, pytest.param(5_000, marks=pytest.mark.nightly)])
def test_warm_start_and_piqp_agree_on_random_problems(problems):
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
@pytest.mark.parametrize(
    ("model", "tier"), [("mdk-net", "slew"), ("mdk-net", "corridor"), ("mdk-net-paper", "slew")]
)
def test_warm_start_and_piqp_agree_on_recorded_problems(model, tier, scenario):
    recording = pytest.importorskip("benchmarks.peers.recording", reason="only in a checkout")
    recorded = recording.record(model, scenario, recording.TIERS[tier])
    program = recorded.program.copy()
    solvers = open_both(program)
    for event in recorded.replay(program):
        if isinstance(event, recording.Matrices):
            assert all(solver.update_matrices() for solver in solvers)
        else:
            assert_same_first_input(solvers)
