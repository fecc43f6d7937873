"""Limits of the inputs: bounds and rates, and the geometry that bounds the wheel."""

from math import atan, inf, radians
from typing import NamedTuple

from rt_controller.contract.signals import GRAVITY_MPS2, ControlInput


class InputLimits(NamedTuple):
    """Lowest and highest input, and the largest change of each per second."""

    lower: ControlInput
    upper: ControlInput
    rate_per_s: ControlInput

    def with_wheel(self, most_rad: float) -> "InputLimits":
        """The same with a steering wheel between ±`most_rad`."""
        lower, upper, rate_per_s = self
        return InputLimits(
            lower._replace(steer_rad=-most_rad), upper._replace(steer_rad=most_rad), rate_per_s
        )


INPUT_LIMITS = InputLimits(
    lower=ControlInput(throttle=0.0, brake_n=0.0, steer_rad=-radians(40.0)),
    upper=ControlInput(throttle=1.0, brake_n=150.0, steer_rad=radians(40.0)),
    rate_per_s=ControlInput(throttle=2.5, brake_n=500.0, steer_rad=radians(200.0)),
)
"""The paper's bounds; the rates are this project's choice for "limited to realistic driving"."""

RELEASED_THROTTLE, RELEASED_BRAKE_N = 1e-3, 0.15
"""below these a pedal counts as released: one thousandth of its travel"""

LEAST_FRICTION, MOST_FRICTION = 0.05, 1.5
"""of a road; 1 is the road of the tyre test"""

PEDAL_CHANGE_S = 0.15
"""time to move the foot from one pedal to the other"""

GRIP_AHEAD_S, NEAR, FAR = 0.5, 0.2113, 0.7887
"""time ahead over which a path is compared with it, about the horizon of the controller, and the
places in it. These are the Gauss points: there a fitted cubic has about the curvature of its path,
at its ends up to 1.5 times as much"""


class SteeringGeometry(NamedTuple):
    """A car that rolls without sideslip of its tyres, as it does at walking pace."""

    wheelbase_m: float
    """front axle to rear axle"""
    rear_axle_m: float
    """centre of gravity to rear axle"""
    steering_ratio: float
    """angle of the steering wheel over the angle of the front wheels"""
    lock_rad: float = INPUT_LIMITS.upper.steer_rad
    """largest angle of the steering wheel; where it is not known 40 deg"""

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

    def largest_wheel_rad(
        self, vx_mps: float, lateral_mps2: float, accepted_mps2: float = inf
    ) -> float:
        """Bound of the steering-wheel angle at a speed: 40 deg, or more at low speed.

        Beyond 40 deg a steady turn stays within `lateral_mps2`, and the wheel within its lock. At
        any angle it stays within `accepted_mps2`: of a fast car the bound is less than 40 deg.
        """
        per_rad_mps2 = max(self.steady_lateral_mps2(vx_mps, 1.0), 1e-6)
        by_speed_rad = min(self.lock_rad, lateral_mps2 / per_rad_mps2)
        least_rad = INPUT_LIMITS.upper.steer_rad
        return min(max(by_speed_rad, least_rad), accepted_mps2 / per_rad_mps2)


DEFAULT_GEOMETRY = SteeringGeometry(
    wheelbase_m=2.910, rear_axle_m=1.8604, steering_ratio=18.5, lock_rad=radians(540.0)
)
"""of the default car (`sim_bridge/cars/c_class_150kw_awd.toml`)"""
PLAN_STEER_RAD = radians(300.0)
"""largest angle of a plan, and of training data"""
UNDERSTEER_RAD_PER_MPS2 = radians(1.43) / GRAVITY_MPS2
"""of the front wheels with compliance, per lateral acceleration: target of the default car"""
