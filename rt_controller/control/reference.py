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

    def expand(self, path: PathReference, state: VehicleState, curvature_per_m: float) -> Array:
        """The reference states (N, 6) along `path`, seen from `state`.

        Lateral velocity is wanted to be zero; its weight decides how much that matters.
        """
        wanted_mps = np.maximum(path.v_mps + path.a_mps2 * self._elapsed_s, 0.0)
        # The car arrives where its present speed, drifting to the wanted one, will bring it.
        sigma_m = 0.5 * (state.vx_mps + wanted_mps) * self._elapsed_s
        ey_m = path.c0_m + sigma_m * (
            path.c1 + sigma_m * (path.c2_per_m + sigma_m * path.c3_per_m2)
        )
        slope = path.c1 + sigma_m * (2.0 * path.c2_per_m + 3.0 * path.c3_per_m2 * sigma_m)
        bend_per_m = 2.0 * path.c2_per_m + 6.0 * path.c3_per_m2 * sigma_m

        x = self.states
        x[:, 0] = wanted_mps
        x[:, 1] = 0.0
        x[:, 2] = wanted_mps * (curvature_per_m + bend_per_m)
        x[:, 3] = wanted_mps * PERIOD_S
        x[:, 4] = ey_m
        x[:, 5] = np.arctan(slope)
        return x
