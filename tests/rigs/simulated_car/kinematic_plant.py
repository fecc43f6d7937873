"""A car without tyres as a plant, cheap to drive."""

import numpy as np

from rt_controller.contract.signals import ControlInput
from sim_bridge import PlantOutputs


class KinematicCar:
    """A plant that is not a subclass of anything in this project."""

    name = "kinematic"
    failure: str | None = None

    def __init__(self, fails_after_s: float = np.inf) -> None:
        self._fails_after_s = fails_after_s
        self._time_s = 0.0

    def reset(self, v0_mps: float) -> np.ndarray:
        self._v_mps, self._time_s = v0_mps, 0.0
        return np.array([v0_mps, 0.0, 0.0])

    def step(self, control: ControlInput, dt_s: float) -> np.ndarray:
        self._time_s += dt_s
        if self._time_s > self._fails_after_s:
            self.failure = "the test"
            return np.full((1, 3), np.nan)
        self._v_mps += dt_s * (4.0 * control.throttle - 0.02 * control.brake_n - 0.3)
        return np.array([[self._v_mps, 0.0, self._v_mps * control.steer_rad / 43.0]])

    def outputs(self) -> PlantOutputs:
        return PlantOutputs()

    def close(self) -> None: ...
