"""The condensed QP is the paper's problem: same optimum as the sparse form with states."""

import numpy as np
import piqp
import pytest
from scipy.linalg import block_diag

from rt_controller.contract.artifact import Array, Bilinear, Bundle, LiftSample
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.follow import Follow
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import ControlInput, VehicleState
from rt_controller.control.cost import TrackingCost, output_weights
from rt_controller.control.prediction import forced_response, free_response, impulse_responses
from rt_controller.control.qp import CondensedQp, assemble
from rt_controller.control.solver import PiqpWorkspace, SolveStatus

HORIZON = 12
N_OBSERVABLES = 10
COST = TrackingCost(
    state=VehicleState(1.0, 2.0, 0.3, 0.5, 0.2, 0.02),
    control=ControlInput(0.5, 60.0, 0.5),
    control_change=ControlInput(0.2, 40.0, 0.1),
    latent_weight=0.05,
    terminal_factor=2.0,
)
RANGE = np.array(INPUT_LIMITS.upper) - np.array(INPUT_LIMITS.lower)


def random_bundle(rng: np.random.Generator, rank: int = 0) -> Bundle:
    n = N_OBSERVABLES
    A = rng.normal(size=(n, n))
    A *= 0.97 / max(abs(np.linalg.eigvals(A)))
    size = np.array([0.3, 0.003, 0.4])
    bilinear = Bilinear(
        N=rng.normal(size=(rank, n, 3)) * size,
        S=rng.normal(size=(rank, 3, n)),
        s0=rng.normal(size=(rank, 3)),
        follows=Follow.START if rank % 2 else Follow.FREE_RESPONSE,
    )
    return Bundle(
        name="random",
        A=A,
        B_uc=rng.normal(size=(n, 3)) * size,
        B_uw=rng.normal(size=(n, 1)),
        c=0.05 * rng.normal(size=n),
        bilinear=bilinear if rank > 0 else None,
        encoder_onnx=b"",
        selftest=LiftSample(np.zeros((1, 6)), np.zeros((1, 1)), np.zeros((1, 0, 0))),
        selftest_psi=np.zeros((1, n)),
        training="{}",
        data_sha256="",
    )


def optimum(
    P: Array, c: Array, G: Array, box: tuple[Array, ...], A: Array | None, b: Array | None
) -> Array:
    """The minimiser, to high accuracy; `box` bounds G x from both sides, then x."""
    solver = piqp.DenseSolver()
    solver.settings.eps_abs = 1e-10
    solver.settings.eps_rel = 0.0
    solver.settings.eps_duality_gap_abs = 1e-11
    solver.settings.eps_duality_gap_rel = 0.0
    equality = None if A is None else np.asfortranarray(A)
    solver.setup(np.asfortranarray(P), c, equality, b, np.asfortranarray(G), *box)
    assert solver.solve() == piqp.PIQP_SOLVED
    return np.array(solver.result.x)


def sparse_plan(
    bundle: Bundle, cost: TrackingCost, psi_0: Array, kappa: float, u_prev: Array, y_r: Array
) -> Array:
    """Inputs (N, 3) of eq. (14) with the states kept as variables."""
    n, m, N = bundle.n_observables, 3, HORIZON
    p = y_r.shape[1]
    weights = np.zeros((N, n))
    weights[:, :p] = output_weights(cost, n - 6).over(N).reshape(N, p)
    wanted = np.zeros((N, n))
    wanted[:, :p] = y_r
    r = 1.0 / np.square(np.array(cost.control))
    s = 1.0 / np.square(np.array(cost.control_change))
    D = np.eye(N * m) - np.eye(N * m, k=-m)
    P = block_diag(np.diag(np.tile(r, N)) + (D.T * np.tile(s, N)) @ D, np.diag(weights.ravel()))
    c = np.zeros(N * (m + n))
    c[:m] = -s * u_prev
    c[N * m :] = -(weights * wanted).ravel()
    A_eq = np.zeros((N * n, N * (m + n)))
    b_eq = np.tile(bundle.B_uw[:, 0] * kappa + bundle.c, N)
    b_eq[:n] += bundle.A @ psi_0
    follows = None if bundle.bilinear is None else bundle.bilinear.follows
    frozen = psi_0
    for k in range(N):
        rows = slice(k * n, (k + 1) * n)
        A_eq[rows, k * m : (k + 1) * m] = -bundle.input_matrix(frozen)
        if follows is Follow.FREE_RESPONSE:
            frozen = bundle.A @ frozen + bundle.B_uw[:, 0] * kappa + bundle.c
        A_eq[rows, N * m + k * n : N * m + (k + 1) * n] = np.eye(n)
        if k > 0:
            A_eq[rows, N * m + (k - 1) * n : N * m + k * n] = -bundle.A
    slew = np.tile(np.array(INPUT_LIMITS.rate_per_s) * bundle.schema.dt_s, N)
    low, high = -slew, slew.copy()
    low[:m] += u_prev
    high[:m] += u_prev
    free = np.full(N * n, np.inf)
    lower = np.concatenate([np.tile(np.array(INPUT_LIMITS.lower), N), -free])
    upper = np.concatenate([np.tile(np.array(INPUT_LIMITS.upper), N), free])
    G = np.hstack([D, np.zeros((N * m, N * n))])
    # Solved in units of the ranges: tolerances know no newtons beside radians.
    unit = np.concatenate([np.tile(RANGE, N), np.ones(N * n)])
    box = (low / unit[: N * m], high / unit[: N * m], lower / unit, upper / unit)
    x = optimum(P * unit * unit[:, None], c * unit, G, box, A_eq * unit, b_eq)
    return (x * unit)[: N * m].reshape(N, m)


def aim(
    qp: CondensedQp, psi_0: Array, kappa: float, u_prev: Array, y_r: Array
) -> tuple[Array, Array]:
    """The slew bounds of this situation, the objective aimed at it."""
    qp.situation.psi[:] = psi_0
    qp.situation.road[:] = kappa
    qp.situation.previous[:] = u_prev
    qp.situation.reference[:] = y_r
    qp.objective.aim(qp.situation)
    low, high = -qp.constraints.slew, qp.constraints.slew.copy()
    low[:3] += u_prev / RANGE
    high[:3] += u_prev / RANGE
    return low, high


@pytest.mark.parametrize("latent_weight", [0.0, 0.05])
@pytest.mark.parametrize("rank", [0, 1, 4])
@pytest.mark.parametrize("seed", range(3))
def test_condensed_and_sparse_forms_share_their_plan(
    seed: int, rank: int, latent_weight: float
) -> None:
    rng = np.random.default_rng(seed)
    bundle, cost = random_bundle(rng, rank), COST._replace(latent_weight=latent_weight)
    qp = assemble(bundle, HORIZON, cost, INPUT_LIMITS)
    workspace = PiqpWorkspace(qp.objective, qp.constraints)
    for _ in range(3):
        psi_0 = 0.3 * rng.normal(size=N_OBSERVABLES)
        y_r = 0.3 * rng.normal(size=qp.situation.reference.shape)
        u_prev = rng.uniform(INPUT_LIMITS.lower, INPUT_LIMITS.upper)
        sparse = sparse_plan(bundle, cost, psi_0, 0.002, u_prev, y_r)
        low, high = aim(qp, psi_0, 0.002, u_prev, y_r)
        lower, upper = qp.constraints.lower, qp.constraints.upper
        exact = optimum(
            qp.objective.H,
            qp.objective.gradient,
            qp.constraints.D,
            (low, high, lower, upper),
            None,
            None,
        )
        np.testing.assert_allclose(exact.reshape(-1, 3), sparse / RANGE, rtol=0.0, atol=1e-6)
        assert workspace.solve(low, high, upper) is SolveStatus.SOLVED
        np.testing.assert_allclose(workspace.solution[:3], sparse[0] / RANGE, rtol=0.0, atol=1e-4)


def test_the_condensed_prediction_is_the_model_rolled_out() -> None:
    rng = np.random.default_rng(3)
    bundle = random_bundle(rng)
    free = free_response(bundle, HORIZON, 6)
    Gamma = forced_response(impulse_responses(bundle.A, bundle.B_uc, HORIZON, 6))
    psi_0, U, kappa = rng.normal(size=N_OBSERVABLES), rng.normal(size=(HORIZON, 3)), 0.004
    psi, rolled = psi_0, []
    for u in U:
        psi = bundle.A @ psi + bundle.B_uc @ u + bundle.B_uw[:, 0] * kappa + bundle.c
        rolled.append(psi[:6])
    predicted = free.Phi @ psi_0 + Gamma @ U.ravel() + free.lam * kappa + free.mu
    np.testing.assert_allclose(predicted, np.concatenate(rolled), rtol=1e-10, atol=1e-10)


def test_without_latent_weight_only_physical_states_are_tracked() -> None:
    bundle = random_bundle(np.random.default_rng(4))
    qp = assemble(bundle, HORIZON, COST._replace(latent_weight=0.0), INPUT_LIMITS)
    assert qp.situation.reference.shape == (HORIZON, 6)
    assert qp.situation.vector.shape == (N_OBSERVABLES + 2 + 3 + 6 * HORIZON,)


@pytest.mark.parametrize("rank", [0, 2])
def test_a_model_that_overflows_is_refused(rank: int) -> None:
    bundle = random_bundle(np.random.default_rng(5), rank)
    bundle.A[:] = 1e200
    with np.errstate(all="ignore"), pytest.raises(ArtifactError, match="not finite"):
        assemble(bundle, HORIZON, COST, INPUT_LIMITS)


def test_gains_that_overflow_are_refused() -> None:
    bundle = random_bundle(np.random.default_rng(5), rank=2)
    assert bundle.bilinear is not None
    bundle.bilinear.s0[:] = 1e200
    with pytest.raises(ArtifactError, match="not finite"):
        assemble(bundle, HORIZON, COST, INPUT_LIMITS)


@pytest.mark.parametrize("rank", [0, 2])
def test_an_input_that_costs_nothing_is_refused(rank: int) -> None:
    bundle = random_bundle(np.random.default_rng(6), rank)
    bundle.B_uc[:, 1] = 0.0
    free = ControlInput(np.inf, np.inf, np.inf)
    with pytest.raises(ArtifactError, match="convex"):
        assemble(bundle, HORIZON, COST._replace(control=free, control_change=free), INPUT_LIMITS)
