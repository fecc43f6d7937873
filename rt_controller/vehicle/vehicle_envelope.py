"""The vehicle's own envelope: which commands it refuses, from any sender.

Pure functions of a command, of the vehicle's own measurements, and of the description of the car
(`rt_controller.contract.car`), whose limits are taken with the rounding of a frame.
"""

from math import atan, isfinite, radians
from typing import NamedTuple

from rt_controller.bus.messages import Command
from rt_controller.contract.car import DEFAULT_CAR, Car
from rt_controller.contract.faults import NO_REFUSAL, Refusal
from rt_controller.contract.limits import RELEASED_BRAKE_N, RELEASED_THROTTLE
from rt_controller.contract.signals import ControlInput, Mode, PathReference, VehicleState
from rt_controller.contract.timing import COMMAND_TIMEOUT_TICKS, PERIOD_S

MOVING_MPS = 1.0
"""a slower car is about to stand"""
OFF_PATH_AHEAD_S = 0.3
FARTHEST_OFF_PATH_M, FARTHEST_DRIVEN_M = 0.5, 0.9
"""in a safe stop, and while the controller drives; beyond it the vehicle stops by itself, along its
path"""
_ROUNDING = ControlInput(throttle=2e-5, brake_n=0.0025, steer_rad=radians(0.02))
"""one step of each signal of ACT_CMD"""


class OwnMotion(NamedTuple):
    """Motion of the vehicle by its own measurement, not from the bus."""

    speed_mps: float
    off_path_m: float
    """see `off_path_m`"""
    is_mission_on: bool
    """it requests the controller to drive"""


STANDING = OwnMotion(0.0, 0.0, is_mission_on=True)


def refusals(
    command: Command, before: ControlInput, periods: int, motion: OwnMotion, car: Car = DEFAULT_CAR
) -> Refusal:
    """Why the content of a command must not be followed; none if it may.

    Args:
        command: as received, with any values.
        before: the last command that was followed.
        periods: since `before`; the wheel may have moved in each of them.
        motion: of the car, by its own measurement.
        car: the description of the car.
    """
    control = command.control
    if not all(map(isfinite, control)):
        return Refusal.STEERING
    found = NO_REFUSAL
    if contradicts_mode(command, motion):
        found |= Refusal.MODE
    if control.throttle > RELEASED_THROTTLE and control.brake_n > RELEASED_BRAKE_N:
        found |= Refusal.PEDALS
    is_bounded = is_within_bounds(control, car)
    if not is_bounded or not is_reachable(control, before, periods, car):
        found |= Refusal.STEERING
    lateral_mps2 = car.geometry.steady_lateral_mps2(motion.speed_mps, control.steer_rad)
    if abs(lateral_mps2) > car.largest_lateral_mps2:
        found |= Refusal.LATERAL_ACCELERATION
    return found


def contradicts_mode(command: Command, motion: OwnMotion) -> bool:
    """True for throttle in a mode that does not drive, or a moving car that is left in STANDBY."""
    mode = command.mode
    if mode.closes_throttle and command.control.throttle > RELEASED_THROTTLE:
        return True
    return mode is Mode.STANDBY and motion.is_mission_on and motion.speed_mps > MOVING_MPS


def leaves_path(command: Command, motion: OwnMotion, has_reached_path: bool) -> bool:
    """True if the car leaves its path although the controller steers it: the vehicle takes over.

    Args:
        command: that is followed.
        motion: of the car, by its own measurement.
        has_reached_path: False while a car that began beside its path is still on the way to it.
    """
    if motion.speed_mps <= MOVING_MPS:
        return False
    if command.mode is Mode.SAFE_STOP:
        return abs(motion.off_path_m) > FARTHEST_OFF_PATH_M
    is_judged = has_reached_path and motion.is_mission_on and command.mode is not Mode.STANDBY
    return is_judged and abs(motion.off_path_m) > FARTHEST_DRIVEN_M


def is_within_bounds(control: ControlInput, car: Car = DEFAULT_CAR) -> bool:
    """True if each input is within its bounds, but for the rounding of a frame."""
    lower = car.limits.lower._replace(steer_rad=-car.geometry.lock_rad)
    upper = car.limits.upper._replace(steer_rad=car.geometry.lock_rad)
    return all(
        low - step <= value <= high + step
        for value, low, high, step in zip(control, lower, upper, _ROUNDING, strict=True)
    )


def is_reachable(
    control: ControlInput, before: ControlInput, periods: int, car: Car = DEFAULT_CAR
) -> bool:
    """True if the wheel can have moved so far within its rate, in at most a time-out."""
    change_rad = car.limits.rate_per_s.steer_rad * PERIOD_S
    largest_rad = change_rad * min(max(periods, 1), COMMAND_TIMEOUT_TICKS)
    return abs(control.steer_rad - before.steer_rad) <= largest_rad + 2.0 * _ROUNDING.steer_rad


def off_path_m(path: PathReference, state: VehicleState, curvature_per_m: float) -> float:
    """Lateral deviation from the path after `OFF_PATH_AHEAD_S`, left positive.

    By the heading or by the motion with v_y and yaw rate, whichever is larger.

    Args:
        path: at the car.
        state: of the car, as it measures it itself.
        curvature_per_m: of the road at the car.
    """
    off_m = state.ey_m - path.c0_m
    ahead_mps = state.vx_mps * (state.epsi_rad - atan(path.c1))
    turn_per_m = curvature_per_m + 2.0 * path.c2_per_m
    away_mps2 = state.vx_mps * (state.yaw_rate_radps - state.vx_mps * turn_per_m)
    by_motion_mps = ahead_mps + state.vy_mps + 0.5 * OFF_PATH_AHEAD_S * away_mps2
    return max(
        off_m + OFF_PATH_AHEAD_S * ahead_mps, off_m + OFF_PATH_AHEAD_S * by_motion_mps, key=abs
    )
