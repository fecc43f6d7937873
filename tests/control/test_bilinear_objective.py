"""The bilinear objective equals the cost of the model rolled out, and allocates no matrix."""

import tracemalloc
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from made_models import input_matrix, make_bundle

from rt_controller.config import MpcSettings
from rt_controller.contract.arrays import Array
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.model.follow import Follow
from rt_controller.contract.model.lift import Lift
from rt_controller.contract.model.rollout import roll_out
from rt_controller.control.objective import Objective
from rt_controller.control.pedals import PedalChoice
from rt_controller.control.piqp_solver import PiqpSolver
from rt_controller.control.qp import CondensedQp
from rt_controller.control.solver import SolveStatus

HORIZON = 20
SPAN = np.subtract(INPUT_LIMITS.upper, INPUT_LIMITS.lower)


def build(bundle: Bundle) -> CondensedQp:
    settings = MpcSettings(horizon=HORIZON)
    return CondensedQp(bundle, HORIZON, settings.cost())


def objective_at(bundle: Bundle, psi_0: Array) -> Objective:
    """Objective at psi_0; all other parameters are the same for every model."""
    qp, rng = build(bundle), np.random.default_rng(1)
    qp.parameters.psi[:] = psi_0
    qp.parameters.curvature_per_m[:] = 0.002
    qp.parameters.previous[:] = (0.2, 10.0, 0.1)
    qp.parameters.reference[:] = rng.normal(size=qp.parameters.reference.shape)
    qp.parameters.nominal_inputs[:] = SPAN * nominal_inputs()
    qp.objective.update_matrices(qp.parameters)
    qp.objective.update_vectors(qp.parameters)
    return qp.objective


def nominal_inputs() -> Array:
    """(N, 3), in units of the ranges."""
    return 0.3 * np.random.default_rng(5).normal(size=(HORIZON, 3))


def assert_same(one: Objective, other: Objective) -> None:
    np.testing.assert_allclose(one.H, other.H, rtol=1e-10, atol=1e-12 * np.abs(other.H).max())
    scale = np.abs(other.gradient).max()
    np.testing.assert_allclose(one.gradient, other.gradient, rtol=1e-10, atol=1e-12 * scale)


def following(bundle: Bundle, follows: Follow) -> Bundle:
    assert bundle.bilinear is not None
    return replace(bundle, bilinear=bundle.bilinear._replace(follows=follows))


VARIANTS = {
    "bilinear of rank 1": {"rank": 1},
    "bilinear": {"rank": 4},
    "saturating": {"rank": 4, "saturates": True},
    "bilinear with drift": {"rank": 1, "drift": 2},
    "saturating with drift": {"rank": 3, "saturates": True, "drift": 2},
}
variants = pytest.mark.parametrize("variant", VARIANTS.values(), ids=VARIANTS.keys())


def made(variant: dict[str, int], follows: Follow) -> Bundle:
    return following(make_bundle(Lift(), bend=0.5, **variant), follows)


def drift_of(bundle: Bundle, psi: Array) -> Array:
    """What the drift adds at psi (n,) on the road of `objective_at`: (n,)."""
    if bundle.drift is None:
        return np.zeros(bundle.n_observables)
    return np.asarray(bundle.drift.N @ bundle.drift.terms(psi, np.array([0.002])))


@variants
def test_frozen_at_psi_0_the_objective_is_that_of_a_linear_model(variant: dict[str, int]) -> None:
    """Its input matrix is B_eff at psi_0, and the drift at psi_0 belongs to its offset."""
    bundle = made(variant, Follow.START)
    for psi_0 in bundle.selftest_psi[:4]:
        frozen = replace(
            bundle,
            B_uc=input_matrix(bundle, psi_0),
            c=bundle.c + drift_of(bundle, psi_0),
            bilinear=None,
            drift=None,
        )
        assert not np.allclose(frozen.B_uc, bundle.B_uc, rtol=0.01)
        assert_same(objective_at(bundle, psi_0), objective_at(frozen, psi_0))


def rolled_out_cost(bundle: Bundle, psi_0: Array, V: Array, expected: Array) -> float:
    """Cost of the inputs V (N, 3), in units of their ranges, from a roll-out step by step.

    Input matrices and drift are those along the nominal inputs `expected` (N, 3), as `Follow` says.
    """
    follows = Follow.PREDICTION if bundle.bilinear is None else bundle.bilinear.follows
    settings = MpcSettings(horizon=HORIZON)
    cost, rng = settings.cost(), np.random.default_rng(1)
    qp = build(bundle)
    reference = rng.normal(size=qp.parameters.reference.shape)
    tolerated = np.array(cost.state)
    psi, followed, before, total = psi_0, psi_0, np.array([0.2, 10.0, 0.1]), 0.0
    for k, v in enumerate(V):
        u = SPAN * v
        free = 0.002 * bundle.B_uw[:, 0] + bundle.c
        matrix, drift = input_matrix(bundle, followed), drift_of(bundle, followed)
        psi = bundle.A @ psi + matrix @ u + free + drift
        if follows is not Follow.START:
            followed = bundle.A @ followed + free
        if follows is Follow.PREDICTION:
            followed = followed + matrix @ (SPAN * expected[k]) + drift
        last = cost.terminal_factor if k == HORIZON - 1 else 1.0
        total += last * np.sum(((psi[:6] - reference[k]) / tolerated) ** 2)
        total += np.sum((u / np.array(cost.control)) ** 2)
        total += np.sum(((u - before) / np.array(cost.control_change)) ** 2)
        before = u
    return float(total)


@pytest.mark.parametrize("follows", Follow)
@variants
def test_the_objective_is_the_cost_of_a_roll_out_step_by_step(
    variant: dict[str, int], follows: Follow
) -> None:
    assert_cost_of_a_roll_out(made(variant, follows))


def test_the_objective_of_a_drift_alone_is_the_cost_of_a_roll_out_step_by_step() -> None:
    bundle = make_bundle(Lift(), bend=0.5, drift=2)
    assert bundle.bilinear is None
    assert_cost_of_a_roll_out(bundle)


def assert_cost_of_a_roll_out(bundle: Bundle) -> None:
    psi_0, expected = bundle.selftest_psi[0], nominal_inputs()
    objective = objective_at(bundle, psi_0)
    rng = np.random.default_rng(2)
    at_rest = rolled_out_cost(bundle, psi_0, np.zeros((HORIZON, 3)), expected)
    for _ in range(5):
        V = 0.3 * rng.normal(size=(HORIZON, 3))
        v = V.reshape(-1)
        found = v @ objective.H @ v + 2.0 * objective.gradient @ v
        assert found == pytest.approx(
            rolled_out_cost(bundle, psi_0, V, expected) - at_rest, rel=1e-9
        )


@variants
def test_the_nominal_inputs_are_predicted_as_by_the_model(variant: dict[str, int]) -> None:
    """So a plan that repeats itself is a plan of the bilinear model."""
    bundle = made(variant, Follow.PREDICTION)
    psi_0, V = bundle.selftest_psi[0], nominal_inputs()
    on_road = np.full((1, HORIZON, 1), 0.002)
    rolled = roll_out(bundle, psi_0[None], (SPAN * V)[None], on_road, outputs=6)[0, 1:]
    settings = MpcSettings(horizon=HORIZON)
    cost, reference = settings.cost(), np.random.default_rng(1).normal(size=(HORIZON, 6))
    errors = ((rolled - reference) / np.array(cost.state)) ** 2
    errors[-1] *= cost.terminal_factor
    changes = np.diff(np.vstack([[0.2, 10.0, 0.1], SPAN * V]), axis=0) / cost.control_change
    sizes = SPAN * V / np.array(cost.control)
    expected = errors.sum() + np.square(changes).sum() + np.square(sizes).sum()
    assert rolled_out_cost(bundle, psi_0, V, V) == pytest.approx(float(expected), rel=1e-12)


def test_each_choice_of_followed_states_gives_another_hessian() -> None:
    bundle = make_bundle(Lift(), rank=2, bend=0.5)
    psi_0 = bundle.selftest_psi[0]
    at = [objective_at(following(bundle, follows), psi_0).H for follows in Follow]
    for one, other in combinations(at, 2):
        assert not np.allclose(one, other, rtol=1e-3)


def test_with_zero_gains_the_objective_is_that_of_the_linear_model() -> None:
    bundle = make_bundle(Lift(), rank=3)
    assert bundle.bilinear is not None
    S, s0 = 0.0 * bundle.bilinear.S, 0.0 * bundle.bilinear.s0
    still = replace(bundle, bilinear=bundle.bilinear._replace(S=S, s0=s0))
    psi_0 = bundle.selftest_psi[0]
    assert_same(objective_at(still, psi_0), objective_at(replace(bundle, bilinear=None), psi_0))


def test_only_the_matrices_of_a_bilinear_model_or_of_one_with_drift_vary() -> None:
    bundle = make_bundle(Lift(), rank=1)
    assert build(bundle).objective.hessian_varies
    assert build(make_bundle(Lift(), drift=1)).objective.hessian_varies
    assert not build(replace(bundle, bilinear=None)).objective.hessian_varies


def test_what_the_drift_adds_to_e_y_is_that_of_the_roll_out() -> None:
    bundle = make_bundle(Lift(), rank=3, bend=0.5, saturates=True, drift=2)
    psi_0, U = bundle.selftest_psi[0], SPAN * nominal_inputs()
    psi, without, expected = psi_0, psi_0, []
    for u in U:
        same = input_matrix(bundle, psi) @ u + 0.002 * bundle.B_uw[:, 0] + bundle.c
        psi, without = bundle.A @ psi + same + drift_of(bundle, psi), bundle.A @ without + same
        expected.append(psi[4] - without[4])
    found = objective_at(bundle, psi_0).ey_drift
    assert found is not None
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    assert build(replace(bundle, drift=None)).objective.ey_drift is None


@pytest.mark.parametrize("variant", [{"rank": 4}, {"rank": 4, "saturates": True, "drift": 4}])
def test_an_update_allocates_no_matrix(variant: dict[str, int]) -> None:
    qp = build(make_bundle(Lift(), **variant))
    objective = qp.objective
    before = (id(objective.H), id(objective.gradient))
    objective.update_matrices(qp.parameters)
    objective.update_vectors(qp.parameters)
    tracemalloc.start()
    objective.update_matrices(qp.parameters)
    objective.update_vectors(qp.parameters)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < objective.H.nbytes / 3
    assert (id(objective.H), id(objective.gradient)) == before


@pytest.mark.parametrize("psi_0", [np.nan, np.inf, 1e200])
@pytest.mark.parametrize("variant", [{"rank": 2}, {"rank": 2, "drift": 2}])
def test_a_non_finite_lifted_state_is_a_status_and_does_not_affect_the_next_solve(
    variant: dict[str, int], psi_0: float
) -> None:
    bundle = make_bundle(Lift(), **variant)
    qp = build(bundle)
    solver, pedals = PiqpSolver(qp.program), PedalChoice()
    typical = qp.parameters.psi.copy()
    qp.parameters.reference[:] = typical[:6]
    qp.update_matrices()
    assert solver.update_matrices()
    qp.update_vectors(pedals)
    assert solver.solve() is SolveStatus.SOLVED
    expected = solver.solution.copy()

    qp.parameters.psi[-1] = psi_0
    with np.errstate(all="ignore"):
        qp.update_matrices()
        assert not solver.update_matrices()
        qp.update_vectors(pedals)
    assert solver.solve() is SolveStatus.NUMERICS
    qp.parameters.psi[:] = typical
    qp.update_matrices()
    assert solver.update_matrices()
    qp.update_vectors(pedals)
    assert solver.solve() is SolveStatus.SOLVED
    np.testing.assert_allclose(solver.solution, expected, rtol=0.0, atol=1e-6)
