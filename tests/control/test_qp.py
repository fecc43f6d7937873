"""The condensed QP is the paper's problem: same optimum as the sparse form with states."""

import numpy as np
import piqp
import pytest
from scipy.sparse import block_diag, csc_matrix

from rt_controller.contract.artifact import Array, Bundle
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import ControlInput, VehicleState
from rt_controller.control.cost import TrackingCost, output_weights
from rt_controller.control.prediction import condense
from rt_controller.control.qp import CondensedQp, assemble
from rt_controller.control.solver import PiqpWorkspace, SolveStatus

HORIZON = 12
COST = TrackingCost(
    state=VehicleState(1.0, 2.0, 0.3, 0.5, 0.2, 0.02),
    control=ControlInput(3.0, 300.0, 2.0),
    control_change=ControlInput(0.2, 40.0, 0.1),
    latent_weight=0.05,
    terminal_factor=2.0,
)


def random_bundle(rng: np.random.Generator, n: int = 10) -> Bundle:
    A = rng.normal(size=(n, n))
    A *= 0.97 / max(abs(np.linalg.eigvals(A)))
    return Bundle(
        name="random",
        A=A,
        B_uc=rng.normal(size=(n, 3)) * np.array([0.3, 0.003, 0.4]),
        B_uw=rng.normal(size=(n, 1)),
        c=0.05 * rng.normal(size=n),
        encoder_onnx=b"",
        selftest_x=np.zeros((1, 6)),
        selftest_psi=np.zeros((1, n)),
        training="{}",
        data_sha256="",
    )


def sparse_optimum(
    bundle: Bundle, cost: TrackingCost, psi_0: Array, kappa: float, u_prev: Array, y_r: Array
) -> Array:
    """First input of eq. (14) with the states kept as variables, solved to high accuracy."""
    n, m, N = bundle.n_observables, 3, HORIZON
    weights = output_weights(cost, n - 6, N).reshape(N, n)
    r = 1.0 / np.square(np.array(cost.control))
    s = 1.0 / np.square(np.array(cost.control_change))
    D = np.eye(N * m) - np.eye(N * m, k=-m)
    P = block_diag([np.diag(np.tile(r, N)) + (D.T * np.tile(s, N)) @ D, np.diag(weights.ravel())])
    c = np.zeros(N * (m + n))
    c[:m] = -s * u_prev
    c[N * m :] = -(weights * y_r).ravel()
    A_eq = np.zeros((N * n, N * (m + n)))
    b_eq = np.tile(bundle.B_uw[:, 0] * kappa + bundle.c, N)
    b_eq[:n] += bundle.A @ psi_0
    for k in range(N):
        rows = slice(k * n, (k + 1) * n)
        A_eq[rows, k * m : (k + 1) * m] = -bundle.B_uc
        A_eq[rows, N * m + k * n : N * m + (k + 1) * n] = np.eye(n)
        if k > 0:
            A_eq[rows, N * m + (k - 1) * n : N * m + k * n] = -bundle.A
    slew = np.tile(np.array(INPUT_LIMITS.rate_per_s) * bundle.dt_s, N)
    low, high = -slew, slew.copy()
    low[:m] += u_prev
    high[:m] += u_prev
    free = np.full(N * n, np.inf)
    solver = piqp.SparseSolver()
    solver.settings.eps_abs = 1e-10
    solver.settings.eps_duality_gap_abs = 1e-10
    solver.setup(
        csc_matrix(P),
        c,
        csc_matrix(A_eq),
        b_eq,
        csc_matrix(np.hstack([D, np.zeros((N * m, N * n))])),
        low,
        high,
        np.concatenate([np.tile(np.array(INPUT_LIMITS.lower), N), -free]),
        np.concatenate([np.tile(np.array(INPUT_LIMITS.upper), N), free]),
    )
    assert solver.solve() == piqp.PIQP_SOLVED
    return np.array(solver.result.x[:m])


def condensed_optimum(
    qp: CondensedQp, psi_0: Array, kappa: float, u_prev: Array, y_r: Array
) -> Array:
    operand = np.concatenate([psi_0, [kappa, 1.0], u_prev, y_r.ravel()])
    low, high = -qp.slew, qp.slew.copy()
    low[:3] += u_prev / qp.scale[:3]
    high[:3] += u_prev / qp.scale[:3]
    workspace = PiqpWorkspace(qp)
    assert workspace.solve(qp.gradient_map @ operand, low, high, qp.upper) is SolveStatus.SOLVED
    return (workspace.solution * qp.scale)[:3]


@pytest.mark.parametrize("seed", range(8))
def test_condensed_and_sparse_forms_share_their_first_input(seed: int) -> None:
    rng = np.random.default_rng(seed)
    bundle = random_bundle(rng)
    qp = assemble(bundle, HORIZON, COST, INPUT_LIMITS)
    psi_0 = 0.3 * rng.normal(size=10)
    y_r = 0.3 * rng.normal(size=(HORIZON, 10))
    u_prev = rng.uniform(np.array(INPUT_LIMITS.lower), np.array(INPUT_LIMITS.upper))
    sparse = sparse_optimum(bundle, COST, psi_0, 0.002, u_prev, y_r)
    condensed = condensed_optimum(qp, psi_0, 0.002, u_prev, y_r)
    range_ = np.array(INPUT_LIMITS.upper) - np.array(INPUT_LIMITS.lower)
    np.testing.assert_allclose(condensed / range_, sparse / range_, atol=1e-4)


def test_the_condensed_prediction_is_the_model_rolled_out() -> None:
    rng = np.random.default_rng(3)
    bundle = random_bundle(rng)
    model = condense(bundle, HORIZON, 6)
    psi_0, U, kappa = rng.normal(size=10), rng.normal(size=(HORIZON, 3)), 0.004
    psi, rolled = psi_0, []
    for u in U:
        psi = bundle.A @ psi + bundle.B_uc @ u + bundle.B_uw[:, 0] * kappa + bundle.c
        rolled.append(psi[:6])
    predicted = model.Phi @ psi_0 + model.Gamma @ U.ravel() + model.lam * kappa + model.mu
    np.testing.assert_allclose(predicted, np.concatenate(rolled), rtol=1e-10, atol=1e-10)


def test_without_latent_weight_only_physical_states_are_tracked() -> None:
    bundle = random_bundle(np.random.default_rng(4))
    qp = assemble(bundle, HORIZON, COST._replace(latent_weight=0.0), INPUT_LIMITS)
    assert qp.n_outputs == 6
    assert qp.gradient_map.shape == (3 * HORIZON, 10 + 2 + 3 + 6 * HORIZON)


def test_a_model_that_overflows_is_refused() -> None:
    bundle = random_bundle(np.random.default_rng(5))
    bundle.A[:] = 1e200
    with np.errstate(all="ignore"), pytest.raises(ArtifactError, match="not finite"):
        assemble(bundle, HORIZON, COST, INPUT_LIMITS)


def test_an_input_that_costs_nothing_is_refused() -> None:
    bundle = random_bundle(np.random.default_rng(6))
    bundle.B_uc[:, 1] = 0.0
    free = ControlInput(np.inf, np.inf, np.inf)
    with pytest.raises(ArtifactError, match="convex"):
        assemble(bundle, HORIZON, COST._replace(control=free, control_change=free), INPUT_LIMITS)
