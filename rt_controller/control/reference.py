"""Reference states over the horizon, from the path polynomial on the bus."""

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import PathReference, StateColumn, VehicleState
from rt_controller.contract.timing import PERIOD_S


class ReferenceHorizon:
    """Reference states x_r of stages 1 … N, in preallocated memory.

    Stage k is where the car will be after k periods. Heading and yaw rate follow the path's slope
    and curvature. Holding the present reference over the horizon would give several times the
    lateral error.
    """

    def __init__(self, horizon: int) -> None:
        self.states = np.zeros((horizon, len(VehicleState._fields)))
        """(N, 6), columns as `VehicleState`"""
        self._elapsed_s = PERIOD_S * np.arange(1, horizon + 1)
        self._powers = np.ones((horizon, 4))
        """1, sigma, sigma^2, sigma^3 of each stage"""

    def expand(self, path: PathReference, state: VehicleState, curvature_per_m: float) -> Array:
        """Reference states (N, 6) along `path`, seen from `state`.

        The reference of the lateral velocity is zero.
        """
        c0, c1, c2, c3, v_mps, a_mps2 = path
        speed_mps = np.maximum(v_mps + a_mps2 * self._elapsed_s, 0.0)
        # Arc length at the mean of the present speed and the reference speed of the stage.
        sigma_m = 0.5 * (state.vx_mps + speed_mps) * self._elapsed_s
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

        x = self.states
        x[:, StateColumn.vx_mps] = speed_mps
        np.multiply(speed_mps, curvature, out=x[:, StateColumn.yaw_rate_radps])
        np.multiply(speed_mps, PERIOD_S, out=x[:, StateColumn.ds_m])
        x[:, StateColumn.ey_m] = ey_m
        np.arctan(slope, out=x[:, StateColumn.epsi_rad])
        return x
