"""Geometry of the car that steering without a learned model needs: the single-track model."""

from math import atan, radians
from typing import NamedTuple

from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.physics import GRAVITY_MPS2


class SteeringGeometry(NamedTuple):
    """A car that rolls without sideslip of its tyres, as it does at walking pace."""

    wheelbase_m: float
    """front axle to rear axle"""
    rear_axle_m: float
    """centre of gravity to rear axle"""
    steering_ratio: float
    """angle of the steering wheel over the angle of the front wheels"""
    lock_rad: float = INPUT_LIMITS.upper.steer_rad
    """largest angle of the steering wheel; by default no more than that of the plan"""

    def steady_wheel_rad(self, vx_mps: float, yaw_rate_radps: float) -> float:
        """Steering-wheel angle of a steady turn, with the understeer of the default car."""
        rolling_rad = atan(self.wheelbase_m * yaw_rate_radps / vx_mps)
        return self.steering_ratio * (
            rolling_rad + UNDERSTEER_RAD_PER_MPS2 * yaw_rate_radps * vx_mps
        )

    def steady_lateral_mps2(self, vx_mps: float, steer_rad: float) -> float:
        """Lateral acceleration of a steady turn with this steering-wheel angle."""
        front_rad, squared = steer_rad / self.steering_ratio, vx_mps**2
        return squared * front_rad / (self.wheelbase_m + UNDERSTEER_RAD_PER_MPS2 * squared)

    def largest_wheel_rad(self, vx_mps: float, lateral_mps2: float) -> float:
        """Bound of the steering-wheel angle at a speed: 40 deg, or more at low speed.

        Beyond 40 deg a steady turn stays within `lateral_mps2`, and the wheel within its lock.
        """
        per_rad_mps2 = self.steady_lateral_mps2(vx_mps, 1.0)
        by_speed_rad = min(self.lock_rad, lateral_mps2 / max(per_rad_mps2, 1e-6))
        return max(by_speed_rad, INPUT_LIMITS.upper.steer_rad)


SMALLEST = SteeringGeometry(wheelbase_m=0.5, rear_axle_m=0.0, steering_ratio=1.0, lock_rad=0.1)
LARGEST = SteeringGeometry(wheelbase_m=10.0, rear_axle_m=10.0, steering_ratio=100.0, lock_rad=30.0)
"""limits of a road vehicle, 1:1 models included"""

DEFAULT_GEOMETRY = SteeringGeometry(
    wheelbase_m=2.910, rear_axle_m=1.8604, steering_ratio=18.5, lock_rad=radians(540.0)
)
"""of the default car (`sim_bridge/cars/c_class_150kw_awd.toml`)"""
UNNAMED_GEOMETRY = DEFAULT_GEOMETRY._replace(lock_rad=INPUT_LIMITS.upper.steer_rad)
"""for models of an unnamed car"""
PLAN_TURN_MPS2 = 7.0
"""lateral acceleration up to which a plan may use a larger angle than 40 deg"""
PLAN_STEER_RAD = radians(180.0)
"""largest angle of a plan, and of training data"""
UNDERSTEER_RAD_PER_MPS2 = radians(1.43) / GRAVITY_MPS2
"""of the front wheels with compliance, per lateral acceleration: target of the default car"""
