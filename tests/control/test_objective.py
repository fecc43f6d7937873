"""The condensed objective equals the cost computed from predicted outputs, stage by stage."""

from dataclasses import replace

import numpy as np
import pytest
from made_models import make_bundle, one_step
from model_classes import RANGE, VARIANTS, knots_of, made

from rt_controller.config import MpcSettings
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import N_STATES, ControlInput
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.objective import SLOWEST_MPS, QpParameters
from rt_controller.control.pedals import PedalChoice
from rt_controller.control.piqp_solver import PiqpSolver
from rt_controller.control.program import SolveStatus
from rt_controller.control.qp import CondensedQp
from rt_controller.control.terms import Heading, TrackingCost
from rt_controller.model.bundle import Bundle
from rt_controller.model.lift import Lift

HORIZON = 12
COSTS = [
    MpcSettings(terminal_factor=factor, heading=heading)
    .cost()
    ._replace(control=ControlInput(1.0, 100.0, 2.0))
    for heading in ("course", "epsi")
    for factor in (1.0, 4.0)
]


def built(bundle: Bundle, cost: TrackingCost, knots: int, psi: Array) -> CondensedQp:
    """The QP linearised along a plan, with parameters that are the same for every model."""
    qp, rng = CondensedQp(bundle, HORIZON, cost, knots=knots), np.random.default_rng(1)
    parameters = qp.parameters
    parameters.psi[:], parameters.curvature_per_m = psi, 0.002
    parameters.previous[:] = (0.2, 10.0, 0.1)
    parameters.reference[:] = psi[:N_STATES] + 0.2 * rng.normal(size=parameters.reference.shape)
    parameters.nominal_knots[:] = knots_of(knots)
    parameters.nominal_inputs[:] = qp.interpolation @ parameters.nominal_knots
    qp.update_matrices()
    qp.update_vectors(PedalChoice())
    return qp


def predicted(bundle: Bundle, now: QpParameters, inputs: Array) -> Array:
    """States (N + 1, 6), the present one first."""
    psi, found = now.psi, [now.psi[:N_STATES]]
    for u in inputs:
        psi = one_step(bundle, psi, u, np.array([now.curvature_per_m]))
        found.append(psi[:N_STATES])
    return np.array(found)


def naive_cost(qp: CondensedQp, bundle: Bundle, cost: TrackingCost, knots: Array) -> float:
    """Cost of eq. (14); the course is a change of e_y over the distance in the nominal plan."""
    now, inputs = qp.parameters, qp.interpolation @ knots
    nominal_mps = predicted(bundle, now, now.nominal_inputs)[:, 0]
    states, before, total = predicted(bundle, now, inputs), now.previous, 0.0
    begins, ends = qp.knots.stages, qp.knots.ends
    for j, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        errors = states[end] - now.reference[j + 1]
        if cost.heading == "course":
            turned_m = errors[4] - (states[begin, 4] - now.reference[j, 4])
            time_s = PERIOD_S * (end - begin)
            errors[5] = turned_m / (time_s * max(nominal_mps[end], SLOWEST_MPS))
        factor = cost.terminal_factor if end == HORIZON else 1.0
        total += factor * (end - begin) * np.sum((errors / np.array(cost.state)) ** 2)
    for u in inputs:
        total += np.sum((u / np.array(cost.control)) ** 2)
        total += np.sum(((u - before) / np.array(cost.control_change)) ** 2)
        before = u
    return 0.5 * float(total)


def objective_of(qp: CondensedQp, knots: Array) -> float:
    v = (knots / RANGE).reshape(-1)
    return float(0.5 * v @ qp.objective.H @ v + qp.objective.gradient @ v)


@pytest.mark.parametrize("knots", [5, HORIZON])
@pytest.mark.parametrize("cost", COSTS, ids=lambda c: f"{c.heading} {c.terminal_factor:g}")
def test_the_objective_of_a_linear_model_is_the_cost_of_its_prediction(
    cost: TrackingCost, knots: int
) -> None:
    bundle, rng = made("linear"), np.random.default_rng(2)
    for psi in bundle.selftest_psi[:3]:
        qp = built(bundle, cost, knots, psi)
        at_rest = naive_cost(qp, bundle, cost, np.zeros((knots, 3)))
        for _ in range(3):
            plan = RANGE * 0.3 * rng.normal(size=(knots, 3))
            expected = naive_cost(qp, bundle, cost, plan) - at_rest
            assert objective_of(qp, plan) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("knots", [5, HORIZON])
@pytest.mark.parametrize("heading", ["course", "epsi"])
@pytest.mark.parametrize("variant", VARIANTS)
def test_along_the_nominal_plan_the_gradient_is_that_of_the_cost_of_the_model(
    variant: str, heading: Heading, knots: int
) -> None:
    """So a plan that repeats itself is stationary for the nonlinear model."""
    bundle, cost = made(variant), COSTS[-1]._replace(heading=heading)
    qp = built(bundle, cost, knots, bundle.selftest_psi[0])
    nominal = qp.parameters.nominal_knots.copy()
    found = qp.objective.H @ (nominal / RANGE).reshape(-1) + qp.objective.gradient
    expected = np.zeros_like(found)
    for i in range(found.size):
        step = np.zeros(found.size)
        step[i] = 1e-4
        step = RANGE * step.reshape(-1, 3)
        after, before = (naive_cost(qp, bundle, cost, nominal + s * step) for s in (1.0, -1.0))
        expected[i] = (after - before) / 2e-4
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())


def test_of_a_linear_model_the_gradient_follows_state_and_road_without_new_matrices() -> None:
    bundle = made("linear")
    qp = built(bundle, COSTS[-1], 5, bundle.selftest_psi[0])
    qp.parameters.psi[:] = bundle.selftest_psi[1]
    qp.parameters.curvature_per_m = -0.004
    qp.update_vectors(PedalChoice())
    found = qp.objective.gradient.copy()
    qp.update_matrices()
    qp.update_vectors(PedalChoice())
    scale = np.abs(found).max()
    np.testing.assert_allclose(found, qp.objective.gradient, rtol=0.0, atol=1e-10 * scale)


def test_with_zero_gains_the_objective_is_that_of_the_linear_model() -> None:
    bundle = make_bundle(Lift(), rank=3)
    S, s0 = 0.0 * bundle.gains.S, 0.0 * bundle.gains.s0
    still = replace(bundle, gains=bundle.gains._replace(S=S, s0=s0))
    one, other = (
        built(each, COSTS[0], 5, bundle.selftest_psi[0]).objective
        for each in (still, replace(bundle, gains=None))
    )
    np.testing.assert_allclose(one.H, other.H, rtol=0.0, atol=1e-12 * np.abs(other.H).max())
    scale = np.abs(other.gradient).max()
    np.testing.assert_allclose(one.gradient, other.gradient, rtol=0.0, atol=1e-12 * scale)


@pytest.mark.parametrize("heading", ["course", "epsi"])
def test_only_the_matrices_of_a_linear_model_with_a_cost_of_epsi_are_constant(
    heading: Heading,
) -> None:
    cost = COSTS[0]._replace(heading=heading)
    for variant in VARIANTS:
        is_constant = variant == "linear" and heading == "epsi"
        assert CondensedQp(made(variant), HORIZON, cost).matrices_vary is not is_constant


@pytest.mark.parametrize("psi_0", [np.nan, np.inf, 1e200])
@pytest.mark.parametrize("variant", ["bilinear", "bilinear with drift"])
def test_a_non_finite_lifted_state_is_a_status_and_does_not_affect_the_next_solve(
    variant: str, psi_0: float
) -> None:
    bundle = made(variant)
    qp = CondensedQp(bundle, HORIZON, COSTS[0])
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
