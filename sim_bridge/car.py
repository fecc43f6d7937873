"""The car on its road: plant and road frame stepped together, one control period at a time."""

from math import cos

import numpy as np
from numpy import float64
from numpy.typing import NDArray

from rt_controller.contract.signals import ControlInput, VehicleState
from sim_bridge import frenet
from sim_bridge.plant.integrate import STEP_S, STEPS_PER_PERIOD, advance, glance, settle
from sim_bridge.plant.monitor import N_MONITOR, Monitor
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.states import AT


class Car:
    """A simulated car in the Frenet frame of a road; inputs are held over each period."""

    def __init__(self, parameters: Parameters, v0_mps: float) -> None:
        self.parameters = parameters
        self._motion = np.empty((STEPS_PER_PERIOD, 3))
        self._before = np.empty(3)
        self._pose = np.zeros(3)
        self._seen = np.empty(N_MONITOR)
        self._input = ControlInput(throttle=0.0, brake_n=0.0, steer_rad=0.0)
        self._plant = np.empty(0)
        self._state = VehicleState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        self.reset(v0_mps)

    def reset(self, v0_mps: float, ey_m: float = 0.0, epsi_rad: float = 0.0) -> VehicleState:
        """The state of a car that starts anew, driving straight ahead with everything settled.

        Its progress is that of a period before the start, driven the same way on a straight road.
        """
        self._plant = settle(v0_mps, self.parameters)
        self._pose[:] = (0.0, ey_m, epsi_rad)
        self._input = ControlInput(throttle=0.0, brake_n=0.0, steer_rad=0.0)
        ds_m = v0_mps * cos(epsi_rad) * STEPS_PER_PERIOD * STEP_S
        self._state = VehicleState(v0_mps, 0.0, 0.0, ds_m, ey_m, epsi_rad)
        return self._state

    def advance(self, control: ControlInput, curvature_per_m: float) -> VehicleState:
        """The state one period (25 ms) later."""
        self._before[0] = self._plant[AT.vx_mps]
        self._before[1] = self._plant[AT.vy_mps]
        self._before[2] = self._plant[AT.yaw_rate_radps]
        s_before_m = float(self._pose[frenet.S])
        advance(
            self._plant,
            control.throttle,
            control.brake_n,
            control.steer_rad,
            self.parameters,
            STEPS_PER_PERIOD,
            STEP_S,
            self._motion,
        )
        frenet.follow(self._before, self._motion, curvature_per_m, STEP_S, self._pose)
        self._input = control
        self._state = VehicleState(
            vx_mps=float(self._plant[AT.vx_mps]),
            vy_mps=float(self._plant[AT.vy_mps]),
            yaw_rate_radps=float(self._plant[AT.yaw_rate_radps]),
            ds_m=float(self._pose[frenet.S]) - s_before_m,
            ey_m=float(self._pose[frenet.EY]),
            epsi_rad=float(self._pose[frenet.EPSI]),
        )
        return self._state

    @property
    def state(self) -> VehicleState:
        """What the last period ended with."""
        return self._state

    @property
    def s_m(self) -> float:
        """Progress along the road since the last reset."""
        return float(self._pose[frenet.S])

    @property
    def plant_state(self) -> NDArray[float64]:
        """A copy of the plant's whole state vector; see `sim_bridge.plant.states`."""
        return self._plant.copy()

    @property
    def outputs(self) -> Monitor:
        """What else can be seen of the car, under the inputs of the last period."""
        glance(self._plant, *self._input, self.parameters, self._seen)
        return Monitor(*self._seen.tolist())
