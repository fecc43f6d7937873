"""Along its free response a bilinear model is linear, and costs a tick no memory, no exception."""

import tracemalloc
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from made_models import make_bundle

from rt_controller.config import MpcSettings
from rt_controller.contract.artifact import Array, Bundle, Lift
from rt_controller.contract.follow import Follow
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.control.objective import Objective
from rt_controller.control.pedals import PedalChoice
from rt_controller.control.piqp_solver import PiqpSolver
from rt_controller.control.qp import CondensedQp
from rt_controller.control.solver import SolveStatus

HORIZON = 20
SPAN = np.subtract(INPUT_LIMITS.upper, INPUT_LIMITS.lower)


def build(bundle: Bundle) -> CondensedQp:
    settings = MpcSettings(horizon=HORIZON)
    return CondensedQp(bundle, HORIZON, settings.cost(), INPUT_LIMITS)


def aimed(bundle: Bundle, psi_0: Array) -> Objective:
    """The objective at psi_0, the rest of the situation being the same for every model."""
    qp, rng = build(bundle), np.random.default_rng(1)
    qp.situation.psi[:] = psi_0
    qp.situation.road[:] = 0.002
    qp.situation.previous[:] = (0.2, 10.0, 0.1)
    qp.situation.reference[:] = rng.normal(size=qp.situation.reference.shape)
    qp.situation.expected[:] = SPAN * expected_inputs()
    qp.objective.prepare(qp.situation)
    qp.objective.aim(qp.situation)
    return qp.objective


def expected_inputs() -> Array:
    """(N, 3), what the last plan had for the stages, in units of the ranges."""
    return 0.3 * np.random.default_rng(5).normal(size=(HORIZON, 3))


def assert_same(one: Objective, other: Objective) -> None:
    np.testing.assert_allclose(one.H, other.H, rtol=1e-10, atol=1e-12 * np.abs(other.H).max())
    scale = np.abs(other.gradient).max()
    np.testing.assert_allclose(one.gradient, other.gradient, rtol=1e-10, atol=1e-12 * scale)


def following(bundle: Bundle, follows: Follow) -> Bundle:
    assert bundle.bilinear is not None
    return replace(bundle, bilinear=bundle.bilinear._replace(follows=follows))


@pytest.mark.parametrize("rank", [1, 2, 4])
def test_frozen_at_psi_0_it_is_the_objective_of_the_model_whose_input_matrix_is_b_eff(
    rank: int,
) -> None:
    bundle = following(make_bundle(Lift(), rank=rank), Follow.START)
    for psi_0 in bundle.selftest_psi[:4]:
        frozen = replace(bundle, B_uc=bundle.input_matrix(psi_0), bilinear=None)
        assert not np.allclose(frozen.B_uc, bundle.B_uc, rtol=0.01)
        assert_same(aimed(bundle, psi_0), aimed(frozen, psi_0))


def written_out(bundle: Bundle, psi_0: Array, V: Array, expected: Array) -> float:
    """The cost of the inputs V (N, 3), in units of their ranges, rolled out step by step.

    Input matrices are those of the states that the bundle says, along `expected` (N, 3).
    """
    assert bundle.bilinear is not None
    settings = MpcSettings(horizon=HORIZON)
    cost, rng = settings.cost(), np.random.default_rng(1)
    qp = build(bundle)
    wanted = rng.normal(size=qp.situation.reference.shape)
    tolerated = np.array(cost.state)
    psi, followed, before, total = psi_0, psi_0, np.array([0.2, 10.0, 0.1]), 0.0
    for k, v in enumerate(V):
        u = SPAN * v
        undriven = 0.002 * bundle.B_uw[:, 0] + bundle.c
        matrix = bundle.input_matrix(followed)
        psi = bundle.A @ psi + matrix @ u + undriven
        if bundle.bilinear.follows is not Follow.START:
            followed = bundle.A @ followed + undriven
        if bundle.bilinear.follows is Follow.PREDICTION:
            followed = followed + matrix @ (SPAN * expected[k])
        last = cost.terminal_factor if k == HORIZON - 1 else 1.0
        total += last * np.sum(((psi[:6] - wanted[k]) / tolerated) ** 2)
        total += np.sum((u / np.array(cost.control)) ** 2)
        total += np.sum(((u - before) / np.array(cost.control_change)) ** 2)
        before = u
    return float(total)


@pytest.mark.parametrize("follows", Follow)
@pytest.mark.parametrize("rank", [1, 4])
def test_it_is_the_cost_of_the_roll_out_step_by_step(rank: int, follows: Follow) -> None:
    bundle = following(make_bundle(Lift(), rank=rank, bend=0.5), follows)
    psi_0, expected = bundle.selftest_psi[0], expected_inputs()
    objective = aimed(bundle, psi_0)
    rng = np.random.default_rng(2)
    at_rest = written_out(bundle, psi_0, np.zeros((HORIZON, 3)), expected)
    for _ in range(5):
        V = 0.3 * rng.normal(size=(HORIZON, 3))
        v = V.reshape(-1)
        found = v @ objective.H @ v + 2.0 * objective.gradient @ v
        assert found == pytest.approx(written_out(bundle, psi_0, V, expected) - at_rest, rel=1e-9)


def test_an_expected_plan_is_predicted_as_the_bilinear_model_does() -> None:
    """There the linear model and the bilinear one agree: what plans converge to is a plan of it."""
    bundle = following(make_bundle(Lift(), rank=2, bend=0.5), Follow.PREDICTION)
    psi_0, V = bundle.selftest_psi[0], expected_inputs()
    psi, rolled = psi_0, []
    for v in V:
        undriven = 0.002 * bundle.B_uw[:, 0] + bundle.c
        psi = bundle.A @ psi + bundle.input_matrix(psi) @ (SPAN * v) + undriven
        rolled.append(psi[:6])
    settings = MpcSettings(horizon=HORIZON)
    cost, wanted = settings.cost(), np.random.default_rng(1).normal(size=(HORIZON, 6))
    errors = ((np.array(rolled) - wanted) / np.array(cost.state)) ** 2
    errors[-1] *= cost.terminal_factor
    changes = np.diff(np.vstack([[0.2, 10.0, 0.1], SPAN * V]), axis=0) / cost.control_change
    sizes = SPAN * V / np.array(cost.control)
    expected = errors.sum() + np.square(changes).sum() + np.square(sizes).sum()
    assert written_out(bundle, psi_0, V, V) == pytest.approx(float(expected), rel=1e-12)


def test_what_it_follows_matters() -> None:
    bundle = make_bundle(Lift(), rank=2, bend=0.5)
    psi_0 = bundle.selftest_psi[0]
    at = [aimed(following(bundle, follows), psi_0).H for follows in Follow]
    for one, other in combinations(at, 2):
        assert not np.allclose(one, other, rtol=1e-3)


def test_without_gains_it_is_the_objective_of_the_constant_model() -> None:
    bundle = make_bundle(Lift(), rank=3)
    assert bundle.bilinear is not None
    _, S, s0, _ = bundle.bilinear
    still = replace(bundle, bilinear=bundle.bilinear._replace(S=0.0 * S, s0=0.0 * s0))
    psi_0 = bundle.selftest_psi[0]
    assert_same(aimed(still, psi_0), aimed(replace(bundle, bilinear=None), psi_0))


def test_only_a_bilinear_model_gives_the_solver_a_new_hessian() -> None:
    bundle = make_bundle(Lift(), rank=1)
    assert build(bundle).objective.renews_hessian
    assert not build(replace(bundle, bilinear=None)).objective.renews_hessian


def test_aiming_makes_no_matrix_anew() -> None:
    qp = build(make_bundle(Lift(), rank=4))
    objective = qp.objective
    before = (id(objective.H), id(objective.gradient))
    objective.prepare(qp.situation)
    objective.aim(qp.situation)
    tracemalloc.start()
    objective.prepare(qp.situation)
    objective.aim(qp.situation)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < objective.H.nbytes / 3
    assert (id(objective.H), id(objective.gradient)) == before


@pytest.mark.parametrize("psi_0", [np.nan, np.inf, 1e200])
def test_a_lifted_state_that_is_no_number_is_a_status_and_leaves_no_trace(psi_0: float) -> None:
    bundle = make_bundle(Lift(), rank=2)
    qp = build(bundle)
    solver, pedals = PiqpSolver(qp.program), PedalChoice()
    typical = qp.situation.psi.copy()
    qp.situation.reference[:] = typical[:6]
    qp.prepare()
    assert solver.renew()
    qp.aim(pedals)
    assert solver.solve() is SolveStatus.SOLVED
    expected = solver.solution.copy()

    qp.situation.psi[-1] = psi_0
    with np.errstate(all="ignore"):
        qp.prepare()
        assert not solver.renew()
        qp.aim(pedals)
    assert solver.solve() is SolveStatus.NUMERICS
    qp.situation.psi[:] = typical
    qp.prepare()
    assert solver.renew()
    qp.aim(pedals)
    assert solver.solve() is SolveStatus.SOLVED
    np.testing.assert_allclose(solver.solution, expected, rtol=0.0, atol=1e-6)
