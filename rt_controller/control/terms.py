"""Terms of eq. (14): weights from the deviations that an engineer tolerates, and constraints."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.schema import N_INPUTS
from rt_controller.contract.signals import ControlInput, VehicleState
from rt_controller.contract.timing import PERIOD_S


@dataclass(frozen=True, slots=True)
class InputConstraints:
    """lower <= v <= upper and -slew <= D v <= slew, for the nv = 3 N inputs v of a horizon.

    v are the inputs in units of their ranges. At the first stage the change is counted from the
    previous input, so the bounds of those rows move every period.
    """

    D: Array
    """(nv, nv), row (k, i): v_k,i - v_(k-1),i"""
    slew: Array
    """(nv,), the largest change in one period"""
    scale: Array
    """(nv,), the range of each input: u = scale * v"""
    lower: Array
    """(nv,)"""
    upper: Array
    """(nv,)"""


def constrain_inputs(horizon: int) -> InputConstraints:
    """Input bounds of eq. (14) with slew rates added. Paper: eq. (14)."""
    lower, upper = np.array(INPUT_LIMITS.lower), np.array(INPUT_LIMITS.upper)
    range_ = upper - lower
    nv = horizon * N_INPUTS
    return InputConstraints(
        D=np.eye(nv) - np.eye(nv, k=-N_INPUTS),
        slew=np.tile(np.array(INPUT_LIMITS.rate_per_s) * PERIOD_S / range_, horizon),
        scale=np.tile(range_, horizon),
        lower=np.tile(lower / range_, horizon),
        upper=np.tile(upper / range_, horizon),
    )


class Corridor(NamedTuple):
    """Soft bounds on the distance from the path."""

    half_width_m: float
    beyond_m: float
    """excess that costs as much as a tolerated deviation of a state"""

    @property
    def weight(self) -> float:
        return 1.0 / self.beyond_m**2


class TrackingCost(NamedTuple):
    """Deviations that each cost one unit (Bryson's rule): a weight is 1 / tolerance^2.

    An infinite tolerance is a weight of zero.
    """

    state: VehicleState
    """tolerated deviation from the reference at one stage"""
    control: ControlInput
    """tolerated size of an input: R of eq. (14)"""
    control_change: ControlInput
    """tolerated change of an input from one period to the next"""
    latent_weight: float = 0.0
    """weight of every latent; above zero psi_r is the whole lifted reference"""
    terminal_factor: float = 1.0
    """Q_N = terminal_factor * Q"""


class CostTerms(NamedTuple):
    """Cost of eq. (14) with p outputs y a stage, and inputs v in units of their ranges.

    1/2 (y - y_r)' Q (y - y_r) + 1/2 v' H v + (from_previous * u_prev)' v_0, with nv = 3 N inputs.
    """

    stage: Array
    """(p,), the diagonal of Q of one stage"""
    terminal_factor: float
    H: Array
    """(nv, nv), of the inputs and of their changes"""
    from_previous: Array
    """(3,)"""
    scale: Array
    """(nv,), the range of each input: u = scale * v"""

    @property
    def horizon(self) -> int:
        return self.scale.size // N_INPUTS

    def output_weights(self) -> Array:
        """The whole diagonal of Q, (N p,)."""
        weights = np.tile(self.stage, self.horizon)
        weights[-self.stage.size :] *= self.terminal_factor
        return weights


def cost_terms(cost: TrackingCost, constraints: InputConstraints, n_latents: int) -> CostTerms:
    """The terms for these tolerances: p is 6, or 6 + n_latents where latents have a weight.

    Paper: eq. (14), with the cost of changes added.
    """
    with np.errstate(over="ignore"):  # no weight, as an infinite tolerance
        stage = 1.0 / np.square(np.array(cost.state, dtype=float))
    if cost.latent_weight > 0.0:
        stage = np.concatenate([stage, np.full(n_latents, cost.latent_weight)])
    D, scale = constraints.D, constraints.scale
    horizon = scale.size // N_INPUTS
    r = np.square(scale / np.tile(cost.control, horizon))
    s = np.square(scale / np.tile(cost.control_change, horizon))
    # u_prev enters the change of the first stage only: -s (v_0 - u_prev / range).
    from_previous = -s[:N_INPUTS] / scale[:N_INPUTS]
    H = np.diag(r) + (D.T * s) @ D
    return CostTerms(stage, cost.terminal_factor, H, from_previous, scale)
