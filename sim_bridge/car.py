"""A car on its road: any plant and the road frame, advanced together by the control period."""

from math import cos, isfinite

import numpy as np

from rt_controller.contract.signals import AT_REST, ControlInput, VehicleState
from rt_controller.contract.timing import PERIOD_S
from sim_bridge import frenet
from sim_bridge.plant.protocol import Plant


class Car:
    """A simulated car in the Frenet frame of a road; inputs are held over each period."""

    def __init__(self, plant: Plant, v0_mps: float) -> None:
        self.plant = plant
        self._before = np.empty(3)
        self._pose = np.zeros(3)
        self.state = AT_REST
        """at the end of the last period"""
        self.reset(v0_mps)

    def reset(self, v0_mps: float, ey_m: float = 0.0, epsi_rad: float = 0.0) -> VehicleState:
        """The state after a restart: driving straight ahead with everything settled.

        Its progress is that of a period before the start, driven equally on a straight road.
        """
        self._before[:] = self.plant.reset(v0_mps)
        self._pose[:] = (0.0, ey_m, epsi_rad)
        vx_mps, vy_mps, yaw_rate_radps = self._before.tolist()
        ds_m = vx_mps * cos(epsi_rad) * PERIOD_S
        self.state = VehicleState(vx_mps, vy_mps, yaw_rate_radps, ds_m, ey_m, epsi_rad)
        return self.state

    def advance(self, control: ControlInput, curvature_per_m: float) -> VehicleState:
        """The state one control period later; all NaN once the plant has failed."""
        s_before_m = float(self._pose[frenet.S])
        motion = self.plant.step(control, PERIOD_S)
        frenet.advance_pose(
            self._before, motion, curvature_per_m, PERIOD_S / motion.shape[0], self._pose
        )
        self._before[:] = motion[-1]
        vx_mps, vy_mps, yaw_rate_radps = self._before.tolist()
        s_m, ey_m, epsi_rad = self._pose.tolist()
        self.state = VehicleState(vx_mps, vy_mps, yaw_rate_radps, s_m - s_before_m, ey_m, epsi_rad)
        return self.state

    @property
    def is_sound(self) -> bool:
        """True if the state is finite."""
        return isfinite(sum(self.state))

    @property
    def s_m(self) -> float:
        """Progress along the road since the last reset."""
        return float(self._pose[frenet.S])
