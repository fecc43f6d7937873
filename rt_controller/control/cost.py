"""What the controller wants, in an engineer's words: tolerated deviations become weights."""

from typing import NamedTuple

import numpy as np

from rt_controller.contract.bundle import Array
from rt_controller.contract.signals import ControlInput, VehicleState
from rt_controller.control.constraints import N_INPUTS, InputConstraints


class TrackingCost(NamedTuple):
    """Deviations that each cost one unit (Bryson's rule): a weight is 1 / tolerance^2.

    An infinite tolerance means "do not care".
    """

    state: VehicleState
    """tolerated deviation from the reference, one stage"""
    control: ControlInput
    """tolerated size of an input: R of eq. (14)"""
    control_change: ControlInput
    """tolerated change of an input from one period to the next"""
    latent_weight: float = 0.0
    """weight on every latent; above zero psi_r is the whole lifted reference"""
    terminal_factor: float = 1.0
    """Q_N = terminal_factor * Q"""


class OutputWeights(NamedTuple):
    """The diagonal of Q, …, Q, Q_N over a horizon, p outputs a stage."""

    stage: Array
    """(p,), of Q"""
    terminal_factor: float
    """Q_N = terminal_factor * Q"""

    def over(self, horizon: int) -> Array:
        """The whole diagonal, (horizon * p,)."""
        weights = np.tile(self.stage, horizon)
        weights[-self.stage.size :] *= self.terminal_factor
        return weights


def output_weights(cost: TrackingCost, n_latents: int) -> OutputWeights:
    """What deviations of the outputs cost: p is 6, or 6 + n_latents when the latents weigh."""
    stage = 1.0 / np.square(np.array(cost.state, dtype=float))
    if cost.latent_weight > 0.0:
        stage = np.concatenate([stage, np.full(n_latents, cost.latent_weight)])
    return OutputWeights(stage, cost.terminal_factor)


class InputCost(NamedTuple):
    """1/2 v' H v + (from_previous * u_prev)' v_0: what inputs and their changes cost in any model.

    v are the inputs of the horizon in units of their ranges, v_0 those of the first stage.
    """

    H: Array
    """(nv, nv)"""
    from_previous: Array
    """(3,)"""


def input_cost(cost: TrackingCost, constraints: InputConstraints) -> InputCost:
    """R of eq. (14), and the cost of changes. Paper: eq. (14)."""
    D, scale = constraints.D, constraints.scale
    horizon = scale.size // N_INPUTS
    r = np.square(scale / np.tile(cost.control, horizon))
    s = np.square(scale / np.tile(cost.control_change, horizon))
    # u_prev enters the change of the first stage only: -s (v_0 - u_prev / range).
    return InputCost(H=np.diag(r) + (D.T * s) @ D, from_previous=-s[:N_INPUTS] / scale[:N_INPUTS])
