"""The steady turn in which a car is when a scenario begins in a bend, on a hill, or in wind.

A simple driver brings it there before time zero: curvature of the road fed forward to the wheel,
with an integral of what the car turns less than wanted, and PI control of the speed.
"""

from collections import deque
from math import atan2, hypot

from rt_controller.contract.limits import DEFAULT_GEOMETRY, INPUT_LIMITS
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.car import Car
from sim_bridge.plant.protocol import RoadAt
from sim_bridge.scenario.scenario import Start

SLOWEST_MPS = 1.0
"""a slower car starts straight ahead: it creeps, or stands"""
LONGEST_S, STEADY_S = 30.0, 1.0
"""of the driving, and the time for which it has to be steady at its end"""
_STEADY = ControlInput(throttle=0.01, brake_n=1.0, steer_rad=0.004)
_STEADY_MPS, _STEADY_M = 0.01, 0.002
"""largest range of the inputs in that time, and largest errors of speed and place"""
_AHEAD_S, _LEAST_AHEAD_M = 0.8, 4.0
"""in which the driver returns to the path"""
_LEARNED_PER_S = 1.0
"""share of the missing curvature that the integral takes in a second"""
_MPS2_PER_MPS, _MPS2_PER_M = 1.5, 0.8
_FULL_THROTTLE_MPS2, _MPS2_PER_N = 4.5, 0.06


def is_straight(road: RoadAt) -> bool:
    """True if a car on this road is steady with its wheel in the middle, on the level."""
    return not any(
        road._replace(friction_left=0.0, friction_right=0.0, curvature_change_per_m2=0.0)
    )


def settle(car: Car, start: Start, road: RoadAt) -> None:
    """Leave the car at the start, in the steady turn of this road with the inputs that keep it.

    A car that does not become steady, because it lacks the grip or the power, drives straight
    ahead.
    """
    car.reset(start.speed_mps, start.ey_m, start.epsi_rad, start.s_m)
    if start.speed_mps < SLOWEST_MPS or is_straight(road):
        return
    # The clothoid at the start would be another turn in each period.
    road = road._replace(curvature_change_per_m2=0.0)
    per_m, control = road.curvature_per_m, NEUTRAL_INPUT
    missing_per_m = along_mps2 = 0.0
    last = deque[ControlInput](maxlen=round(STEADY_S / PERIOD_S))
    for _ in range(round(LONGEST_S / PERIOD_S)):
        car.set_road(road)
        vx_mps, vy_mps, yaw_rate, _, ey_m, epsi_rad = car.advance(control, per_m)
        if not car.is_sound or vx_mps < 0.5 * start.speed_mps:
            break
        ahead_m = max(_AHEAD_S * vx_mps, _LEAST_AHEAD_M)
        off_m, course_rad = ey_m - start.ey_m, epsi_rad + atan2(vy_mps, vx_mps)
        wanted_per_m = per_m - off_m / ahead_m**2 - 2.0 * course_rad / ahead_m
        missing_per_m += (
            _LEARNED_PER_S * PERIOD_S * (wanted_per_m - yaw_rate / hypot(vx_mps, vy_mps))
        )
        turn_radps = vx_mps * (wanted_per_m + missing_per_m)
        slower_mps = start.speed_mps - vx_mps
        along_mps2 += _MPS2_PER_M * PERIOD_S * slower_mps
        pedal_mps2 = along_mps2 + _MPS2_PER_MPS * slower_mps
        control = ControlInput(
            min(max(pedal_mps2 / _FULL_THROTTLE_MPS2, 0.0), 1.0),
            min(max(-pedal_mps2 / _MPS2_PER_N, 0.0), INPUT_LIMITS.upper.brake_n),
            DEFAULT_GEOMETRY.steady_wheel_rad(vx_mps, turn_radps),
        )
        last.append(control)
        is_steady = abs(slower_mps) < _STEADY_MPS and abs(off_m) < _STEADY_M
        if is_steady and len(last) == last.maxlen and _is_constant(last):
            car.begin_here(start.s_m, start.ey_m, start.epsi_rad + epsi_rad, control)
            return
    car.reset(start.speed_mps, start.ey_m, start.epsi_rad, start.s_m)


def _is_constant(inputs: deque[ControlInput]) -> bool:
    ranges = (max(each) - min(each) for each in zip(*inputs, strict=True))
    return all(found < most for found, most in zip(ranges, _STEADY, strict=True))
