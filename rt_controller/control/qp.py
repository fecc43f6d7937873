"""The paper's MPC as a condensed QP, assembled once; each tick only vectors change.

minimise 1/2 v' H v + f' v over v, the inputs of the horizon in units of their range,
subject to lower <= v <= upper and slew_lower <= D v <= slew_upper.
"""

from dataclasses import dataclass

import numpy as np

from rt_controller.contract.artifact import Array, Bundle
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.limits import InputLimits
from rt_controller.control.cost import TrackingCost, output_weights
from rt_controller.control.prediction import condense

N_INPUTS = 3


@dataclass(frozen=True, slots=True)
class CondensedQp:
    """Everything about the QP that no tick changes, N stages of 3 inputs, nv = 3 N variables.

    The gradient is one product: f = gradient_map @ [psi_0; kappa; 1; u_prev; y_r], where y_r are
    the reference outputs of stages 1 … N.
    """

    H: Array
    """(nv, nv), positive definite"""
    gradient_map: Array
    """(nv, n + 5 + N p)"""
    D: Array
    """(nv, nv), row (k, i): v_k,i - v_(k-1),i"""
    slew: Array
    """(nv,), the largest change in one period, in units of the range"""
    scale: Array
    """(nv,), the range of each input: u = scale * v"""
    lower: Array
    """(nv,)"""
    upper: Array
    """(nv,)"""
    horizon: int
    n_observables: int
    n_outputs: int


def assemble(bundle: Bundle, horizon: int, cost: TrackingCost, limits: InputLimits) -> CondensedQp:
    """Build the QP of eq. (14), with a cost on input changes and slew rates added.

    Raises:
        ArtifactError: the bundle's model makes the problem non-convex or not finite.

    Paper: eq. (14).
    """
    n = bundle.n_observables
    weights = output_weights(cost, n - 6, horizon)
    n_outputs = weights.size // horizon
    model = condense(bundle, horizon, n_outputs)

    range_ = np.array(limits.upper) - np.array(limits.lower)
    scale = np.tile(range_, horizon)
    Gamma = model.Gamma * scale
    D = np.eye(scale.size) - np.eye(scale.size, k=-N_INPUTS)
    r = np.tile(np.square(range_ / np.array(cost.control)), horizon)
    s = np.tile(np.square(range_ / np.array(cost.control_change)), horizon)

    GtQ = Gamma.T * weights
    H = GtQ @ Gamma + np.diag(r) + (D.T * s) @ D
    H = 0.5 * (H + H.T)
    # u_prev enters the first stage's change only: -s (v_0 - u_prev / range).
    from_previous = np.zeros((scale.size, N_INPUTS))
    from_previous[:N_INPUTS] = -np.diag(s[:N_INPUTS] / range_)
    gradient_map = np.column_stack(
        [GtQ @ model.Phi, GtQ @ model.lam, GtQ @ model.mu, from_previous, -GtQ]
    )
    _require_convex(H, gradient_map)
    return CondensedQp(
        H=H,
        gradient_map=np.ascontiguousarray(gradient_map),
        D=D,
        slew=np.tile(np.array(limits.rate_per_s) * bundle.dt_s / range_, horizon),
        scale=scale,
        lower=np.tile(np.array(limits.lower) / range_, horizon),
        upper=np.tile(np.array(limits.upper) / range_, horizon),
        horizon=horizon,
        n_observables=n,
        n_outputs=n_outputs,
    )


def _require_convex(H: Array, gradient_map: Array) -> None:
    if not (np.all(np.isfinite(H)) and np.all(np.isfinite(gradient_map))):
        raise ArtifactError(
            "The model's prediction over the horizon is not finite: expected a model that stays "
            "bounded, found one that overflows. Train again, or shorten --mpc.horizon."
        )
    smallest = float(np.linalg.eigvalsh(H)[0])
    if smallest <= 0.0:
        raise ArtifactError(
            f"The QP is not strictly convex: expected a positive smallest eigenvalue of its "
            f"Hessian, found {smallest:.3g}. Give every input a finite --mpc tolerance of change."
        )
