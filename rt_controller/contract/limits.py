"""Limits of the inputs: bounds and rates, grip beside the brake, geometry that bounds the wheel."""

from math import atan, inf, radians
from typing import NamedTuple

from rt_controller.contract.signals import GRAVITY_MPS2, ControlInput
from rt_controller.contract.timing import PERIOD_S


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


LARGEST_LATERAL_MPS2 = 7.5
"""of a command, in steady state by the single-track model; the shipped scenarios need up to 6.7"""
MOST_LATERAL_MPS2 = 8.5
"""that a path may need at its wanted speed: what a car can do on a dry road"""
GRIP_AHEAD_S, NEAR, FAR = 0.5, 0.2113, 0.7887
"""time ahead over which a path is compared with it, about the horizon of the controller, and the
places in it. These are the Gauss points: there a fitted cubic has about the curvature of its path,
at its ends up to 1.5 times as much"""
MOST_BRAKE_N, BRAKE_RATE_N_PER_S = 75.0, 150.0
"""of a straight car, about 0.4 g: with more, a wet road (friction 0.5) leaves nothing to steer"""
LEAST_BRAKE_N = 25.0
SLOW_MPS, SLOW_BRAKE_N = 9.0, 60.0
"""a slower car brakes with at least this force, 3 m/s^2: it stops within 14 m on a level road, and
also 20 % downhill, where the least force of a faster one does not stop it"""
LEAST_SLOWING_MPS2, TOLERATED_MPS, MORE_BRAKE_N_PER_MPS = 0.8, 0.3, 20.0
"""deceleration that a stop has at least where the grip allows it; excess of the speed over it that
is tolerated; force that is added for each m/s of further excess"""
HARD_BRAKE_N, HARD_BRAKE_RATE_N_PER_S = 100.0, 300.0
"""about 0.5 g, of a car whose place is not known: only a short stop keeps it near its path"""
LESS_BRAKE_N_PER_MPS2 = 20.0
"""on a wet road (friction 0.6) 100 N and a lateral acceleration of 3 m/s^2 exceed the grip"""
FULL_BRAKE_N, FULL_BRAKE_RATE_N_PER_S = (
    INPUT_LIMITS.upper.brake_n,
    INPUT_LIMITS.rate_per_s.brake_n,
)
"""of a car that cannot be steered: only the brake still acts"""
OPEN_THROTTLE_N = 120.0
"""brake force that balances a throttle that is fully open"""


def stop_speed_mps(before_mps: float, vx_mps: float, periods: int = 1) -> float:
    """Largest speed of a stopping car, from that of the tick before; infinite: it begins now."""
    return min(before_mps, vx_mps) - LEAST_SLOWING_MPS2 * PERIOD_S * periods


def least_brake_n(vx_mps: float, stop_mps: float = inf) -> float:
    """Least brake force of a stop, in N: more downhill, where a car gains speed beside a bend.

    Args:
        vx_mps: speed of the car.
        stop_mps: see `stop_speed_mps`.
    """
    if vx_mps < SLOW_MPS:
        return SLOW_BRAKE_N
    more_n = MORE_BRAKE_N_PER_MPS * max(vx_mps - stop_mps - TOLERATED_MPS, 0.0)
    return min(LEAST_BRAKE_N + more_n, SLOW_BRAKE_N)


def brake_beside_n(
    lateral_mps2: float,
    wanted_mps2: float,
    open_throttle: float = 0.0,
    most_n: float = MOST_BRAKE_N,
    least_n: float = LEAST_BRAKE_N,
) -> float:
    """Brake force that leaves grip to a car that turns, in N.

    A car that turns otherwise than its wheel slides: it needs the grip of both.

    Args:
        lateral_mps2: lateral acceleration of the car, left positive.
        wanted_mps2: that of a steady turn with its wheel.
        open_throttle: by which the throttle is open against its command.
        most_n: of a straight car whose throttle is closed.
        least_n: see `least_brake_n`.
    """
    slide_mps2 = abs(wanted_mps2 - lateral_mps2)
    used_mps2 = max(abs(lateral_mps2), abs(wanted_mps2)) + slide_mps2
    beside_n = max(HARD_BRAKE_N - LESS_BRAKE_N_PER_MPS2 * used_mps2, least_n)
    driven_n = OPEN_THROTTLE_N * max(open_throttle, 0.0)
    return min(min(beside_n, most_n) + driven_n, FULL_BRAKE_N)


_LEAST_BOUND_RAD = INPUT_LIMITS.upper.steer_rad


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
        by_speed_rad = max(min(self.lock_rad, lateral_mps2 / per_rad_mps2), _LEAST_BOUND_RAD)
        return min(by_speed_rad, accepted_mps2 / per_rad_mps2)


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
PLAN_STEER_RAD = radians(300.0)
"""largest angle of a plan, and of training data"""
UNDERSTEER_RAD_PER_MPS2 = radians(1.43) / GRAVITY_MPS2
"""of the front wheels with compliance, per lateral acceleration: target of the default car"""
