"""A plant of your own behind the bridge: a kinematic single-track car, driven over virtual CAN.

pip install -e . && python examples/own_plant.py
"""

import numpy as np

from rt_controller import ControlInput, simulate
from sim_bridge import PlantOutputs


class KinematicCar:
    name, failure = "kinematic single-track car", None
    wheelbase_m, steering_ratio, mass_kg, force_n = 2.7, 16.0, 1500.0, 6000.0

    def reset(self, v0_mps):
        self.v_mps = v0_mps
        return np.array([v0_mps, 0.0, 0.0])

    def step(self, control: ControlInput, dt_s):
        force_n = self.force_n * control.throttle - 30.0 * control.brake_n - 12.0 * self.v_mps
        self.v_mps = max(self.v_mps + dt_s * force_n / self.mass_kg, 0.0)
        yaw_rate_radps = self.v_mps * control.steer_rad / self.steering_ratio / self.wheelbase_m
        return np.array([[self.v_mps, 0.0, yaw_rate_radps]])

    def outputs(self):
        return PlantOutputs()

    def close(self): ...


print(simulate("lane_change_60", plant=KinematicCar()).errors)
