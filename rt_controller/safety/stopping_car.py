"""The motion of a braking car that is not measured, below the speeds of the model."""

from math import tan
from typing import NamedTuple

from rt_controller.contract.signals import ControlInput
from rt_controller.contract.steering_geometry import DEFAULT_GEOMETRY, SteeringGeometry
from rt_controller.contract.timing import PERIOD_S

LEAST_MODELLED_MPS = 7.0
"""below it the model has little data, and its predictions drift; slow cars turn by geometry"""


class StoppingCar(NamedTuple):
    """Constants of the car, for its motion without a model."""

    geometry: SteeringGeometry = DEFAULT_GEOMETRY
    brake_mps2_per_n: float = 0.05
    """deceleration; too small a value makes the stop seem longer than it is"""
    throttle_mps2: float = 6.0
    """acceleration with the throttle fully open"""
    modelled_mps: float = LEAST_MODELLED_MPS
    """speed below which the model is not used"""

    def motion(self, vx_mps: float, control: ControlInput) -> tuple[float, float, float]:
        """(v_x, v_y, yaw rate) one period later, without sideslip of the tyres."""
        vx_mps = max(vx_mps - self.brake_mps2_per_n * control.brake_n * PERIOD_S, 0.0)
        wheelbase_m, rear_axle_m, ratio, _ = self.geometry
        yaw_rate = vx_mps * tan(control.steer_rad / ratio) / wheelbase_m
        return vx_mps, rear_axle_m * yaw_rate, yaw_rate
