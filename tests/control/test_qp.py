"""The condensed QP has the optimum of eq. (14) written with its states."""

import numpy as np
import pytest
from made_models import input_matrix
from random_problems import (
    COST,
    HORIZON,
    N_OBSERVABLES,
    RANGE,
    TIERS,
    optimum,
    random_bundle,
    update_vectors,
)
from scipy.linalg import block_diag

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.model.follow import Follow
from rt_controller.contract.signals import ControlInput
from rt_controller.control.objective import free_response
from rt_controller.control.piqp_solver import PiqpSolver
from rt_controller.control.program import QpParameters
from rt_controller.control.qp import CondensedQp, Features
from rt_controller.control.solver import SolveStatus
from rt_controller.control.terms import Corridor, TrackingCost


def dynamics(bundle: Bundle, now: QpParameters) -> tuple[Array, Array]:
    """Equations of all stages for [u; psi]: (N n, N (m + n)) and their right sides."""
    n, m, N = bundle.n_observables, 3, HORIZON
    A_eq = np.zeros((N * n, N * (m + n)))
    undriven = bundle.B_uw[:, 0] * now.curvature_per_m[0] + bundle.c
    b_eq = np.tile(undriven, N)
    b_eq[:n] += bundle.A @ now.psi
    follows = Follow.PREDICTION if bundle.bilinear is None else bundle.bilinear.follows
    frozen = now.psi
    for k in range(N):
        rows = slice(k * n, (k + 1) * n)
        matrix, drift = input_matrix(bundle, frozen), np.zeros(n)
        if bundle.drift is not None:
            drift = bundle.drift.N @ bundle.drift.terms(frozen, now.curvature_per_m)
        A_eq[rows, k * m : (k + 1) * m] = -matrix
        b_eq[rows] += drift
        if follows is not Follow.START:
            frozen = bundle.A @ frozen + undriven
        if follows is Follow.PREDICTION:
            frozen = frozen + matrix @ now.nominal_inputs[k] + drift
        A_eq[rows, N * m + k * n : N * m + (k + 1) * n] = np.eye(n)
        if k > 0:
            A_eq[rows, N * m + (k - 1) * n : N * m + k * n] = -bundle.A
    return A_eq, b_eq


def sparse_plan(
    qp: CondensedQp, bundle: Bundle, cost: TrackingCost, features: Features
) -> tuple[Array, Array]:
    """Inputs (N, 3) and slacks of eq. (14) with the states as variables."""
    now = qp.parameters
    u_prev, y_r = now.previous, now.reference
    n, m, N, p = bundle.n_observables, 3, HORIZON, y_r.shape[1]
    slacks = 0 if features.corridor is None else N
    weights = np.zeros((N, n))
    weights[:, :6] = 1.0 / np.square(np.array(cost.state))
    weights[:, 6:p] = cost.latent_weight
    weights[-1] *= cost.terminal_factor
    reference = np.zeros((N, n))
    reference[:, :p] = y_r
    r = 1.0 / np.square(np.array(cost.control))
    s = 1.0 / np.square(np.array(cost.control_change))
    D = np.eye(N * m) - np.eye(N * m, k=-m)
    slack_weight = 0.0 if features.corridor is None else features.corridor.weight
    P = block_diag(
        np.diag(np.tile(r, N)) + (D.T * np.tile(s, N)) @ D,
        np.diag(weights.ravel()),
        slack_weight * np.eye(slacks),
    )
    q = np.zeros(len(P))
    q[:m] = -s * u_prev
    q[N * m : N * (m + n)] = -(weights * reference).ravel()
    A_eq, b_eq = np.zeros((N * n, len(P))), np.zeros(N * n)
    A_eq[:, : N * (m + n)], b_eq[:] = dynamics(bundle, now)
    G, low, high = np.zeros((0, len(P))), np.zeros(0), np.zeros(0)
    if features.has_slew_rows:
        slew = np.tile(np.array(INPUT_LIMITS.rate_per_s) * bundle.schema.dt_s / RANGE, N)
        G = np.hstack([D, np.zeros((N * m, len(P) - N * m))])
        low, high = -slew, slew.copy()
        low[:m] += u_prev / RANGE
        high[:m] += u_prev / RANGE
    if features.corridor is not None:
        ey = np.zeros((N, len(P)))
        ey[range(N), range(N * m + 4, N * (m + n), n)] = 1.0
        ey[range(N), range(N * (m + n), len(P))] = 1.0
        G = np.vstack([G, ey])
        low = np.append(low, y_r[:, 4] - features.corridor.half_width_m)
        high = np.append(high, y_r[:, 4] + features.corridor.half_width_m)
    free = np.full(len(P) - N * m, np.inf)
    lower = np.concatenate([qp.program.lower[: N * m], -free])
    upper = np.concatenate([qp.program.upper[: N * m], free])  # with the bounds of the pedals
    # Scaled by the ranges, so that one tolerance serves newtons and radians.
    unit = np.concatenate([np.tile(RANGE, N), np.ones(len(free))])
    x = optimum(P * unit * unit[:, None], q * unit, G, (low, high, lower, upper), A_eq * unit, b_eq)
    return (x * unit)[: N * m].reshape(N, m), x[N * (m + n) :]


@pytest.mark.parametrize("features", TIERS.values(), ids=TIERS.keys())
@pytest.mark.parametrize("latent_weight", [0.0, 0.05])
@pytest.mark.parametrize(("rank", "drift"), [(0, 0), (1, 0), (4, 0), (0, 3), (1, 3), (4, 3)])
def test_condensed_and_sparse_forms_have_the_same_plan(
    rank: int, drift: int, latent_weight: float, features: Features
) -> None:
    rng = np.random.default_rng(7 * rank + drift)
    bundle, cost = random_bundle(rng, rank, drift), COST._replace(latent_weight=latent_weight)
    qp = CondensedQp(bundle, HORIZON, cost, features)
    solver, program = PiqpSolver(qp.program), qp.program
    for _ in range(5):
        update_vectors(qp, rng)
        assert solver.update_matrices()
        sparse, slacks = sparse_plan(qp, bundle, cost, features)
        bounds = (program.row_lower, program.row_upper, program.lower, program.upper)
        exact = optimum(program.P, program.q, program.G, bounds, None, None)
        nv = qp.scale.size
        np.testing.assert_allclose(exact[:nv].reshape(-1, 3), sparse / RANGE, rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(exact[nv:], slacks, rtol=0.0, atol=1e-6)
        assert solver.solve() is SolveStatus.SOLVED
        np.testing.assert_allclose(solver.solution[:3], sparse[0] / RANGE, rtol=0.0, atol=1e-4)


@pytest.mark.parametrize(("half_width_m", "is_left"), [(0.02, True), (50.0, False)])
def test_slacks_are_nonzero_only_outside_the_corridor(half_width_m: float, is_left: bool) -> None:
    """A corridor that is never left would pass the comparison above."""
    features = Features(corridor=Corridor(half_width_m, 0.05))
    qp = CondensedQp(random_bundle(np.random.default_rng(3)), HORIZON, COST, features)
    update_vectors(qp, np.random.default_rng(3))
    solver = PiqpSolver(qp.program)
    assert solver.solve() is SolveStatus.SOLVED
    slacks = solver.solution[qp.scale.size :]
    assert bool(np.abs(slacks).max() > 1e-3) is is_left


@pytest.mark.parametrize("rank", [0, 2])
def test_a_corridor_needs_no_tolerance_of_the_lateral_deviation(rank: int) -> None:
    bundle, features = random_bundle(np.random.default_rng(8), rank), TIERS["corridor"]
    without = COST._replace(state=COST.state._replace(ey_m=np.inf))
    qps = [CondensedQp(bundle, HORIZON, cost, features) for cost in (COST, without)]
    for qp in qps:
        update_vectors(qp, np.random.default_rng(8))
    np.testing.assert_allclose(qps[0].program.G, qps[1].program.G, rtol=1e-12)
    assert PiqpSolver(qps[1].program).solve() is SolveStatus.SOLVED


def test_the_free_response_is_the_model_rolled_out_without_inputs() -> None:
    rng = np.random.default_rng(3)
    bundle = random_bundle(rng)
    psi_0, kappa = rng.normal(size=N_OBSERVABLES), 0.004
    psi, rolled = psi_0, []
    for _ in range(HORIZON):
        psi = bundle.A @ psi + bundle.B_uw[:, 0] * kappa + bundle.c
        rolled.append(psi[:6])
    predicted = free_response(bundle, HORIZON, 6) @ np.array([*psi_0, kappa, 1.0])
    np.testing.assert_allclose(predicted, np.concatenate(rolled), rtol=1e-10, atol=1e-10)


def test_without_latent_weight_only_physical_states_are_tracked() -> None:
    bundle = random_bundle(np.random.default_rng(4))
    qp = CondensedQp(bundle, HORIZON, COST._replace(latent_weight=0.0))
    assert qp.parameters.reference.shape == (HORIZON, 6)
    assert qp.parameters.vector.shape == (N_OBSERVABLES + 2 + 3 + 6 * HORIZON,)


@pytest.mark.parametrize("rank", [0, 2])
def test_a_model_that_overflows_is_refused(rank: int) -> None:
    bundle = random_bundle(np.random.default_rng(5), rank)
    bundle.A[:] = 1e200
    with np.errstate(all="ignore"), pytest.raises(ArtifactError, match="not finite"):
        CondensedQp(bundle, HORIZON, COST)


def test_gains_that_overflow_are_refused() -> None:
    bundle = random_bundle(np.random.default_rng(5), rank=2)
    assert bundle.bilinear is not None
    bundle.bilinear.s0[:] = 1e200
    with pytest.raises(ArtifactError, match="not finite"):
        CondensedQp(bundle, HORIZON, COST)


@pytest.mark.parametrize("rank", [0, 2])
def test_an_input_without_cost_is_refused(rank: int) -> None:
    bundle = random_bundle(np.random.default_rng(6), rank)
    bundle.B_uc[:, 1] = 0.0
    free = ControlInput(np.inf, np.inf, np.inf)
    with pytest.raises(ArtifactError, match="convex"):
        CondensedQp(bundle, HORIZON, COST._replace(control=free, control_change=free))
