"""The condensed QP has the objective and solution of the sparse one; its model the Jacobian."""

import numpy as np
import pytest
from made_models import RANGE, VARIANTS, WITH_ALL, knots_of, made, one_step
from random_problems import COST, HORIZON, TIERS, optimum, random_bundle, update_vectors

from rt_controller.config import MpcSettings
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import N_STATES, ControlInput
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.eq14 import SLOWEST_MPS, CondensedQp, Corridor, Linearisation
from rt_controller.control.pedals import PedalChoice
from rt_controller.control.piqp_solver import PiqpSolver
from rt_controller.control.program import SolveStatus
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.dynamics import Step


def sparse_plan(qp, bundle, cost, corridor):
    """Inputs at the knots (K, 3) and slacks of eq. (14) with the states as variables."""
    now = qp
    n, N, nv = bundle.n_observables, HORIZON, qp.scale.size
    ends, between = np.array(qp.knots.ends), qp.knots.intervals[:, None]
    slacks = 0 if corridor is None else len(ends)
    of_states, of_slacks = slice(nv, nv + N * n), slice(nv + N * n, nv + N * n + slacks)
    size = nv + N * n + slacks
    inputs = np.zeros((N * 3, size))  # of all stages, from v
    inputs[:, :nv] = np.kron(qp.T, np.eye(3)) * qp.scale
    changes = inputs - np.vstack([np.zeros((3, size)), inputs[:-3]])
    changed_from = np.concatenate([now.u_prev, np.zeros(3 * (N - 1))])
    states = np.eye(size)[of_states].reshape(N, n, size)

    undriven = bundle.B_uw[:, 0] * now.kappa + bundle.c
    A_eq = states - (bundle.B_uc @ inputs.reshape(N, 3, size))
    A_eq[1:] -= bundle.A @ states[:-1]
    b_eq = np.tile(undriven, (N, 1))
    b_eq[0] += bundle.A @ now.psi_0

    outputs, reference = states[ends - 1, :6].copy(), now.x_r[1:].copy()
    if cost.heading == "course":  # the predicted states are slower than SLOWEST_MPS
        length_m = SLOWEST_MPS * PERIOD_S * between
        ey_m = outputs[:, 4].copy()
        outputs[1:, 5] = (ey_m[1:] - ey_m[:-1]) / length_m[1:]
        outputs[0, 5] = ey_m[0] / length_m[0]
        reference[:, 5] = np.diff(now.x_r[:, 4]) / length_m[:, 0]
        reference[0, 5] += now.psi_0[4] / length_m[0, 0]
    weights = between / np.square(np.array(cost.state))
    weights[-1] *= cost.terminal_factor
    squares = [  # rows, what they are to be, weights
        (outputs.reshape(-1, size), reference.reshape(-1), weights.reshape(-1)),
        (inputs, np.zeros(3 * N), np.tile(1.0 / np.square(np.array(cost.control)), N)),
        (changes, changed_from, np.tile(1.0 / np.square(np.array(cost.control_change)), N)),
    ]
    if corridor is not None:
        weight = np.full(slacks, 1.0 / corridor.beyond_m**2)
        squares.append((np.eye(size)[of_slacks], np.zeros(slacks), weight))
    P = sum((rows.T * w) @ rows for rows, _, w in squares)
    q = -sum((rows.T * w) @ wanted for rows, wanted, w in squares)

    since = np.concatenate([[[1.0]], between[:-1]])
    slew = since * np.array(INPUT_LIMITS.rate_per_s) * PERIOD_S / RANGE
    G, low, high = (np.eye(nv, size) - np.eye(nv, size, k=-3), -slew.reshape(-1), slew.reshape(-1))
    low[:3] += now.u_prev / RANGE
    high[:3] += now.u_prev / RANGE
    if corridor is not None:
        G = np.vstack([G, states[ends - 1, 4] + np.eye(size)[of_slacks]])
        half_m = corridor.half_width_m
        low = np.append(low, now.x_r[1:, 4] - half_m)
        high = np.append(high, now.x_r[1:, 4] + half_m)
    free = np.full(size - nv, np.inf)
    bounds = qp.program.lower[:nv], qp.program.upper[:nv]  # with those of the pedals
    box = (low, high, np.append(bounds[0], -free), np.append(bounds[1], free))
    x = optimum(P, q, G, box, A_eq.reshape(-1, size), b_eq.reshape(-1))
    return x[:nv].reshape(-1, 3), x[of_slacks]


@pytest.mark.parametrize("corridor", TIERS.values(), ids=TIERS.keys())
@pytest.mark.parametrize("heading", ["course", "epsi"])
@pytest.mark.parametrize("knots", [HORIZON, 5])
def test_condensed_and_sparse_forms_have_the_same_plan(knots, heading, corridor):
    rng = np.random.default_rng(7)
    bundle, cost = random_bundle(rng), COST._replace(heading=heading)
    qp = CondensedQp(bundle, HORIZON, cost, corridor, knots)
    solver, program = PiqpSolver(qp.program), qp.program
    for _ in range(5):
        update_vectors(qp, rng)
        assert solver.update_matrices()
        sparse, slacks = sparse_plan(qp, bundle, cost, corridor)
        bounds = (program.row_lower, program.row_upper, program.lower, program.upper)
        exact = optimum(program.P, program.q, program.G, bounds, None, None)
        nv = qp.scale.size
        np.testing.assert_allclose(exact[:nv].reshape(-1, 3), sparse, rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(exact[nv:], slacks, rtol=0.0, atol=1e-6)
        assert solver.solve() is SolveStatus.SOLVED
        np.testing.assert_allclose(solver.solution[:3], sparse[0], rtol=0.0, atol=1e-4)


@pytest.mark.parametrize(("half_width_m", "is_left"), [(0.02, True), (50.0, False)])
def test_slacks_are_nonzero_only_outside_the_corridor(half_width_m, is_left):
    """A corridor that is never left would pass the comparison above."""
    corridor = Corridor(half_width_m, 0.05)
    qp = CondensedQp(random_bundle(np.random.default_rng(3)), HORIZON, COST, corridor)
    update_vectors(qp, np.random.default_rng(3))
    solver = PiqpSolver(qp.program)
    assert solver.solve() is SolveStatus.SOLVED
    slacks = solver.solution[qp.scale.size :]
    assert bool(np.abs(slacks).max() > 1e-3) is is_left


@pytest.mark.parametrize("rank", [0, 2])
def test_a_corridor_needs_no_tolerance_of_the_lateral_deviation(rank):
    bundle, corridor = random_bundle(np.random.default_rng(8), rank), TIERS["corridor"]
    without = COST._replace(state=COST.state._replace(ey_m=np.inf))
    qps = [CondensedQp(bundle, HORIZON, cost, corridor) for cost in (COST, without)]
    for qp in qps:
        update_vectors(qp, np.random.default_rng(8))
    np.testing.assert_allclose(qps[0].program.G, qps[1].program.G, rtol=1e-12)
    assert PiqpSolver(qps[1].program).solve() is SolveStatus.SOLVED


FREE = ControlInput(np.inf, np.inf, np.inf)


@pytest.mark.parametrize("rank", [0, 2])
@pytest.mark.parametrize("wrong", ["A", "gains", "input without cost"])
def test_a_model_without_a_convex_finite_objective_is_refused(rank, wrong):
    bundle, cost, complaint = random_bundle(np.random.default_rng(5), rank), COST, "not finite"
    if wrong == "A" or (rank == 0 and wrong == "gains"):
        bundle.A[:] = 1e200
    elif wrong == "gains":
        bundle.gains.N[:] = 1e200
    else:
        bundle.B_uc[:, 1], complaint = 0.0, "convex"
        cost = COST._replace(control=FREE, control_change=FREE)
    with np.errstate(all="ignore"), pytest.raises(ArtifactError, match=complaint):
        CondensedQp(bundle, HORIZON, cost)


COSTS = [
    MpcSettings(terminal_factor=factor, heading=heading)
    .cost()
    ._replace(control=ControlInput(1.0, 100.0, 2.0))
    for heading in ("course", "epsi")
    for factor in (1.0, 4.0)
]


def built(bundle, cost, knots, psi):
    """The QP linearised along a plan, with parameters that are the same for every model."""
    qp, rng = CondensedQp(bundle, HORIZON, cost, knots=knots), np.random.default_rng(1)
    qp.psi_0[:], qp.kappa = psi, 0.002
    qp.u_prev[:] = (0.2, 10.0, 0.1)
    qp.x_r[:] = psi[:N_STATES] + 0.2 * rng.normal(size=qp.x_r.shape)
    qp.u_nominal[:] = knots_of(knots)
    qp.update_matrices()
    qp.update_vectors()
    qp.update_bounds(PedalChoice())
    return qp


def predicted(bundle, now, inputs):
    """States (N + 1, 6), the present one first."""
    psi, found = now.psi_0, [now.psi_0[:N_STATES]]
    for u in inputs:
        psi = one_step(bundle, psi, u, np.array([now.kappa]))
        found.append(psi[:N_STATES])
    return np.array(found)


def naive_cost(qp, bundle, cost, knots):
    """Cost of eq. (14); the course is a change of e_y over the distance in the nominal plan."""
    now, inputs = qp, qp.T @ knots
    nominal_mps = predicted(bundle, now, qp.T @ qp.u_nominal)[:, 0]
    states, before, total = predicted(bundle, now, inputs), now.u_prev, 0.0
    begins, ends = qp.knots.stages, qp.knots.ends
    for j, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        errors = states[end] - now.x_r[j + 1]
        if cost.heading == "course":
            turned_m = errors[4] - (states[begin, 4] - now.x_r[j, 4])
            time_s = PERIOD_S * (end - begin)
            errors[5] = turned_m / (time_s * max(nominal_mps[end], SLOWEST_MPS))
        factor = cost.terminal_factor if end == HORIZON else 1.0
        total += factor * (end - begin) * np.sum((errors / np.array(cost.state)) ** 2)
    for u in inputs:
        total += np.sum((u / np.array(cost.control)) ** 2)
        total += np.sum(((u - before) / np.array(cost.control_change)) ** 2)
        before = u
    return 0.5 * float(total)


def objective_of(qp, knots):
    v = (knots / RANGE).reshape(-1)
    return float(0.5 * v @ qp.H @ v + qp.f @ v)


@pytest.mark.parametrize("knots", [5, HORIZON])
@pytest.mark.parametrize("cost", COSTS, ids=lambda c: f"{c.heading} {c.terminal_factor:g}")
def test_the_objective_of_a_linear_model_is_the_cost_of_its_prediction(cost, knots):
    bundle, rng = made("linear"), np.random.default_rng(2)
    for psi in bundle.selftest_psi[:3]:
        qp = built(bundle, cost, knots, psi)
        at_rest = naive_cost(qp, bundle, cost, np.zeros((knots, 3)))
        for _ in range(3):
            plan = RANGE * 0.3 * rng.normal(size=(knots, 3))
            expected = naive_cost(qp, bundle, cost, plan) - at_rest
            assert objective_of(qp, plan) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("heading", "knots"), [("course", 5), ("epsi", HORIZON)])
@pytest.mark.parametrize("variant", VARIANTS)
def test_along_the_nominal_plan_the_gradient_is_that_of_the_cost_of_the_model(
    variant, heading, knots
):
    """So a plan that repeats itself is stationary for the nonlinear model."""
    bundle, cost = made(variant), COSTS[-1]._replace(heading=heading)
    qp = built(bundle, cost, knots, bundle.selftest_psi[0])
    nominal = qp.u_nominal.copy()
    found = qp.H @ (nominal / RANGE).reshape(-1) + qp.f
    expected = np.zeros_like(found)
    for i in range(found.size):
        step = np.zeros(found.size)
        step[i] = 1e-4
        step = RANGE * step.reshape(-1, 3)
        after, before = (naive_cost(qp, bundle, cost, nominal + s * step) for s in (1.0, -1.0))
        expected[i] = (after - before) / 2e-4
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())


def test_of_a_linear_model_the_gradient_follows_state_and_road_without_new_matrices():
    bundle = made("linear")
    qp = built(bundle, COSTS[-1], 5, bundle.selftest_psi[0])
    qp.psi_0[:] = bundle.selftest_psi[1]
    qp.kappa = -0.004
    qp.update_vectors()
    qp.update_bounds(PedalChoice())
    found = qp.f.copy()
    qp.update_matrices()
    qp.update_vectors()
    qp.update_bounds(PedalChoice())
    scale = np.abs(found).max()
    np.testing.assert_allclose(found, qp.f, rtol=0.0, atol=1e-10 * scale)


@pytest.mark.parametrize("heading", ["course", "epsi"])
def test_only_the_matrices_of_a_linear_model_with_a_cost_of_epsi_are_constant(heading):
    cost = COSTS[0]._replace(heading=heading)
    for variant in VARIANTS:
        is_constant = variant == "linear" and heading == "epsi"
        assert CondensedQp(made(variant), HORIZON, cost).matrices_vary is not is_constant


BUNDLES = {name: lambda name=name: made(name) for name in VARIANTS}
BUNDLES |= {f"{name}, history": lambda name=name: made(name, lift=WITH_ALL) for name in VARIANTS}
for name in ("lti", "mdk-net", "mdk-net-small", "mdk-net-paper"):
    BUNDLES[name] = lambda name=name: load_bundle(shipped_model(name))


@pytest.mark.parametrize("bundle", BUNDLES.values(), ids=BUNDLES)
def test_the_jacobians_are_finite_differences_of_a_step(bundle):
    bundle, rng = bundle(), np.random.default_rng(3)
    step, inputs = Step(bundle), knots_of(20)
    after = rng.normal(size=(3, N_STATES)) @ np.eye(N_STATES, bundle.n_observables)  # rows y
    for psi_0 in bundle.selftest_psi[:2]:
        found = Linearisation(bundle, 20, range(N_STATES))
        found.update(psi_0, inputs, 0.002)
        psi = psi_0
        for k, u in enumerate(inputs):
            np.testing.assert_allclose(found.psi[k], psi, rtol=1e-12, atol=1e-12)
            at = np.array([*u, 0.002, 1.0])
            by_psi, by_input = np.split(after @ found.J[k], [psi.size], axis=1)
            for _ in range(3):
                d_psi = 1e-5 * bundle.spread * rng.normal(size=psi.size)
                d_at = np.array([*(1e-5 * RANGE * rng.normal(size=3)), 1e-7, 0.0])
                change = 0.5 * after @ (step(psi + d_psi, at + d_at) - step(psi - d_psi, at - d_at))
                expected = by_psi @ d_psi + by_input @ d_at[:4]
                np.testing.assert_allclose(change, expected, atol=1e-6 * np.abs(change).max())
            psi = step(psi, at)
