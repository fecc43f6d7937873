"""From the path polynomial on the bus to the states the car should have over the horizon."""

import numpy as np

from rt_controller.contract.bundle import Array
from rt_controller.contract.signals import PathReference, VehicleState
from rt_controller.contract.timing import PERIOD_S


class ReferenceHorizon:
    """Reference states x_r of stages 1 … N, in preallocated memory.

    The path is previewed: stage k is where the car will be after k periods. Heading and yaw rate
    follow the path's slope and curvature; holding the present reference over the horizon would
    cost several times the lateral error.
    """

    def __init__(self, horizon: int) -> None:
        self.states = np.zeros((horizon, len(VehicleState._fields)))
        """(N, 6), columns as `VehicleState`"""
        self._elapsed_s = PERIOD_S * np.arange(1, horizon + 1)
        self._powers = np.ones((horizon, 4))
        """1, sigma, sigma^2, sigma^3 of each stage"""

    def expand(self, path: PathReference, state: VehicleState, curvature_per_m: float) -> Array:
        """The reference states (N, 6) along `path`, seen from `state`.

        Lateral velocity is wanted to be zero; its weight decides how much that matters.
        """
        c0, c1, c2, c3, v_mps, a_mps2 = path
        wanted_mps = np.maximum(v_mps + a_mps2 * self._elapsed_s, 0.0)
        # The car arrives where its present speed, drifting to the wanted one, will bring it.
        sigma_m = 0.5 * (state.vx_mps + wanted_mps) * self._elapsed_s
        powers = self._powers
        powers[:, 1] = sigma_m
        np.multiply(sigma_m, sigma_m, out=powers[:, 2])
        np.multiply(powers[:, 2], sigma_m, out=powers[:, 3])
        ey_m, slope, curvature = np.dot(
            (
                (c0, c1, c2, c3),
                (c1, 2.0 * c2, 3.0 * c3, 0.0),
                (curvature_per_m + 2.0 * c2, 6.0 * c3, 0.0, 0.0),
            ),
            powers.T,
        )

        x = self.states  # of which v_y stays zero
        x[:, 0] = wanted_mps
        np.multiply(wanted_mps, curvature, out=x[:, 2])
        np.multiply(wanted_mps, PERIOD_S, out=x[:, 3])
        x[:, 4] = ey_m
        np.arctan(slope, out=x[:, 5])
        return x
