"""What the controller wants, in an engineer's words: tolerated deviations become weights."""

from typing import NamedTuple

import numpy as np

from rt_controller.contract.artifact import Array
from rt_controller.contract.signals import ControlInput, VehicleState


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


def output_weights(cost: TrackingCost, n_latents: int, horizon: int) -> Array:
    """The diagonal of Q, …, Q, Q_N over the horizon, (horizon * p,).

    p is 6, or 6 + n_latents when the latents carry weight.
    """
    stage = 1.0 / np.square(np.array(cost.state, dtype=float))
    if cost.latent_weight > 0.0:
        stage = np.concatenate([stage, np.full(n_latents, cost.latent_weight)])
    weights = np.tile(stage, horizon)
    weights[-stage.size :] *= cost.terminal_factor
    return weights
