"""The condensed QP has the optimum of eq. (14) written with its states."""

import numpy as np
import pytest
from random_problems import (
    COST,
    HORIZON,
    RANGE,
    TIERS,
    optimum,
    random_bundle,
    update_vectors,
)

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.objective import SLOWEST_MPS
from rt_controller.control.piqp_solver import PiqpSolver
from rt_controller.control.program import SolveStatus
from rt_controller.control.qp import CondensedQp
from rt_controller.control.terms import Corridor, Heading, TrackingCost
from rt_controller.model.bundle import Bundle


def sparse_plan(
    qp: CondensedQp, bundle: Bundle, cost: TrackingCost, corridor: Corridor | None
) -> tuple[Array, Array]:
    """Inputs at the knots (K, 3) and slacks of eq. (14) with the states as variables."""
    now = qp.parameters
    n, N, nv = bundle.n_observables, HORIZON, qp.scale.size
    ends, between = np.array(qp.knots.ends), qp.knots.intervals[:, None]
    slacks = 0 if corridor is None else len(ends)
    of_states, of_slacks = slice(nv, nv + N * n), slice(nv + N * n, nv + N * n + slacks)
    size = nv + N * n + slacks
    inputs = np.zeros((N * 3, size))  # of all stages, from v
    inputs[:, :nv] = np.kron(qp.interpolation, np.eye(3)) * qp.scale
    changes = inputs - np.vstack([np.zeros((3, size)), inputs[:-3]])
    changed_from = np.concatenate([now.previous, np.zeros(3 * (N - 1))])
    states = np.eye(size)[of_states].reshape(N, n, size)

    undriven = bundle.B_uw[:, 0] * now.curvature_per_m + bundle.c
    A_eq = states - (bundle.B_uc @ inputs.reshape(N, 3, size))
    A_eq[1:] -= bundle.A @ states[:-1]
    b_eq = np.tile(undriven, (N, 1))
    b_eq[0] += bundle.A @ now.psi

    outputs, reference = states[ends - 1, :6].copy(), now.reference[1:].copy()
    if cost.heading == "course":  # the predicted states are slower than SLOWEST_MPS
        length_m = SLOWEST_MPS * PERIOD_S * between
        ey_m = outputs[:, 4].copy()
        outputs[1:, 5] = (ey_m[1:] - ey_m[:-1]) / length_m[1:]
        outputs[0, 5] = ey_m[0] / length_m[0]
        reference[:, 5] = np.diff(now.reference[:, 4]) / length_m[:, 0]
        reference[0, 5] += now.psi[4] / length_m[0, 0]
    weights = between / np.square(np.array(cost.state))
    weights[-1] *= cost.terminal_factor
    squares = [  # rows, what they are to be, weights
        (outputs.reshape(-1, size), reference.reshape(-1), weights.reshape(-1)),
        (inputs, np.zeros(3 * N), np.tile(1.0 / np.square(np.array(cost.control)), N)),
        (changes, changed_from, np.tile(1.0 / np.square(np.array(cost.control_change)), N)),
    ]
    if corridor is not None:
        weight = np.full(slacks, corridor.weight)
        squares.append((np.eye(size)[of_slacks], np.zeros(slacks), weight))
    P = sum((rows.T * w) @ rows for rows, _, w in squares)
    q = -sum((rows.T * w) @ wanted for rows, wanted, w in squares)

    since = np.concatenate([[[1.0]], between[:-1]])
    slew = since * np.array(INPUT_LIMITS.rate_per_s) * PERIOD_S / RANGE
    G, low, high = (
        np.eye(nv, size) - np.eye(nv, size, k=-3),
        -slew.reshape(-1),
        slew.reshape(-1),
    )
    low[:3] += now.previous / RANGE
    high[:3] += now.previous / RANGE
    if corridor is not None:
        G = np.vstack([G, states[ends - 1, 4] + np.eye(size)[of_slacks]])
        half_m = corridor.half_width_m
        low = np.append(low, now.reference[1:, 4] - half_m)
        high = np.append(high, now.reference[1:, 4] + half_m)
    free = np.full(size - nv, np.inf)
    bounds = qp.program.lower[:nv], qp.program.upper[:nv]  # with those of the pedals
    box = (low, high, np.append(bounds[0], -free), np.append(bounds[1], free))
    x = optimum(P, q, G, box, A_eq.reshape(-1, size), b_eq.reshape(-1))
    return x[:nv].reshape(-1, 3), x[of_slacks]


@pytest.mark.parametrize("corridor", TIERS.values(), ids=TIERS.keys())
@pytest.mark.parametrize("heading", ["course", "epsi"])
@pytest.mark.parametrize("knots", [HORIZON, 5])
def test_condensed_and_sparse_forms_have_the_same_plan(
    knots: int, heading: Heading, corridor: Corridor | None
) -> None:
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
def test_slacks_are_nonzero_only_outside_the_corridor(half_width_m: float, is_left: bool) -> None:
    """A corridor that is never left would pass the comparison above."""
    corridor = Corridor(half_width_m, 0.05)
    qp = CondensedQp(random_bundle(np.random.default_rng(3)), HORIZON, COST, corridor)
    update_vectors(qp, np.random.default_rng(3))
    solver = PiqpSolver(qp.program)
    assert solver.solve() is SolveStatus.SOLVED
    slacks = solver.solution[qp.scale.size :]
    assert bool(np.abs(slacks).max() > 1e-3) is is_left


@pytest.mark.parametrize("rank", [0, 2])
def test_a_corridor_needs_no_tolerance_of_the_lateral_deviation(rank: int) -> None:
    bundle, corridor = random_bundle(np.random.default_rng(8), rank), TIERS["corridor"]
    without = COST._replace(state=COST.state._replace(ey_m=np.inf))
    qps = [CondensedQp(bundle, HORIZON, cost, corridor) for cost in (COST, without)]
    for qp in qps:
        update_vectors(qp, np.random.default_rng(8))
    np.testing.assert_allclose(qps[0].program.G, qps[1].program.G, rtol=1e-12)
    assert PiqpSolver(qps[1].program).solve() is SolveStatus.SOLVED


@pytest.mark.parametrize("rank", [0, 2])
def test_a_model_that_overflows_is_refused(rank: int) -> None:
    bundle = random_bundle(np.random.default_rng(5), rank)
    bundle.A[:] = 1e200
    with np.errstate(all="ignore"), pytest.raises(ArtifactError, match="not finite"):
        CondensedQp(bundle, HORIZON, COST)


def test_gains_that_overflow_are_refused() -> None:
    bundle = random_bundle(np.random.default_rng(5), rank=2)
    bundle.gains.s0[:] = 1e200
    with pytest.raises(ArtifactError, match="not finite"):
        CondensedQp(bundle, HORIZON, COST)


@pytest.mark.parametrize("rank", [0, 2])
def test_an_input_without_cost_is_refused(rank: int) -> None:
    bundle = random_bundle(np.random.default_rng(6), rank)
    bundle.B_uc[:, 1] = 0.0
    free = ControlInput(np.inf, np.inf, np.inf)
    with pytest.raises(ArtifactError, match="convex"):
        CondensedQp(bundle, HORIZON, COST._replace(control=free, control_change=free))
