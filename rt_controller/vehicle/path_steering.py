"""Pure-pursuit steering and braking of the vehicle itself, for a stop along its own path."""

from math import copysign, inf, isfinite, radians
from typing import NamedTuple

from rt_controller.contract.braking import SLOW_MPS, brake_beside_n, least_brake_n
from rt_controller.contract.car import DEFAULT_CAR, Car
from rt_controller.contract.limits import UNDERSTEER_RAD_PER_MPS2
from rt_controller.contract.signals import PathReference, VehicleState
from rt_controller.contract.timing import PERIOD_S

PREVIEW_S = 0.7
"""the path is sent for 0.6 s ahead; a longer preview damps, a shorter one tracks more closely"""
NEAREST_M = 5.0
"""shortest preview distance, of a slow car"""
LARGEST_BRAKED_LATERAL_MPS2 = 4.0
"""beside the braking: more would exceed the grip of a dry road, unless the path itself needs it"""
YAW_DAMPING_S = 0.1
"""angle of the front wheels per difference between the yaw rate of the wanted circle and that of
the car: it turns the wheels against a slide of the rear axle"""
TOLERATED_OFF_PATH_M, LESS_BRAKE_N_PER_M = 0.3, 100.0
"""of a car that leaves its path"""
SLOW_TURN_MPS2 = 5.0
"""up to which a slow car turns its wheel further than 40 deg; a faster one only as its bend needs,
since one that slides stays within 40 deg"""
BACK_TO_PATH_MPS2, WHEEL_BACK_RAD = 1.0, radians(20.0)
"""beside what a bend itself needs: of the wanted circle, and of the wheel"""
SLOWEST_MPS = 0.3
"""the wheel of a slower car stays where it is"""


class Course(NamedTuple):
    """The car, its path and the road, as the first arguments of `steer_along`."""

    path: PathReference
    state: VehicleState
    curvature_per_m: float


def steer_along(
    path: PathReference,
    state: VehicleState,
    curvature_per_m: float,
    previous_rad: float,
    car: Car = DEFAULT_CAR,
) -> float:
    """Wheel angle of the coming period that leads the car to its path, in rad.

    The car drives a circle through the point of the path that is `PREVIEW_S` ahead. The wheel angle
    stays within its bounds and its rate, the curvature within `LARGEST_BRAKED_LATERAL_MPS2`.

    Args:
        path: at the car.
        state: of the car, measured by itself.
        curvature_per_m: of the road at the car.
        previous_rad: of the last period; kept at standstill and if a value is not finite.
        car: the description of the car.
    """
    speed_mps = state.vx_mps
    if not speed_mps > SLOWEST_MPS:
        return previous_rad
    ahead_m = max(PREVIEW_S * speed_mps, NEAREST_M)
    c0_m, c1, c2_per_m, c3_per_m2 = path[:4]
    there_m = c0_m + ahead_m * (c1 + ahead_m * (c2_per_m + ahead_m * c3_per_m2))
    course_rad = state.epsi_rad + state.vy_mps / speed_mps
    turn_per_m = curvature_per_m + 2.0 * (there_m - state.ey_m - course_rad * ahead_m) / ahead_m**2
    if not isfinite(turn_per_m):
        return previous_rad
    # A bend turns on; a lane change turns back.
    here_per_m = curvature_per_m + 2.0 * c2_per_m
    later_per_m = here_per_m + 6.0 * c3_per_m2 * ahead_m
    bend_per_m = min(abs(here_per_m), abs(later_per_m)) if here_per_m * later_per_m > 0.0 else 0.0
    bend_mps2 = bend_per_m * speed_mps**2
    largest_mps2 = max(LARGEST_BRAKED_LATERAL_MPS2, bend_mps2 + BACK_TO_PATH_MPS2)
    turn_per_m = copysign(min(abs(turn_per_m), largest_mps2 / speed_mps**2), turn_per_m)
    geometry, limits = car.geometry, car.limits
    per_turn = geometry.wheelbase_m + UNDERSTEER_RAD_PER_MPS2 * speed_mps**2
    damping_rad = YAW_DAMPING_S * (turn_per_m * speed_mps - state.yaw_rate_radps)
    wanted_rad = geometry.steering_ratio * (per_turn * turn_per_m + damping_rad)
    of_bend_rad = geometry.steady_wheel_rad(speed_mps, bend_per_m * speed_mps)
    most_rad = min(max(limits.upper.steer_rad, of_bend_rad + WHEEL_BACK_RAD), geometry.lock_rad)
    if speed_mps < SLOW_MPS:
        most_rad = max(most_rad, geometry.largest_wheel_rad(speed_mps, SLOW_TURN_MPS2))
    wanted_rad = min(max(wanted_rad, -most_rad), most_rad)
    change_rad = limits.rate_per_s.steer_rad * PERIOD_S
    return previous_rad + min(max(wanted_rad - previous_rad, -change_rad), change_rad)


def largest_brake_n(
    course: Course,
    steer_rad: float,
    open_throttle: float = 0.0,
    car: Car = DEFAULT_CAR,
    stop_mps: float = inf,
) -> float:
    """Brake force that leaves the tyres enough grip to steer, in N.

    At 120 km/h in a lane change the car would slide with the whole force. A car that leaves its
    path has too little grip for both: the road is wet, and it brakes less until it is back.

    Args:
        course: of the car.
        steer_rad: wheel angle.
        open_throttle: by which the throttle is open against its command.
        car: the description of the car.
        stop_mps: see `stop_speed_mps`.
    """
    path, state, _ = course
    beyond_m = max(abs(state.ey_m - path.c0_m) - TOLERATED_OFF_PATH_M, 0.0)
    force_n = brake_beside_n(state, steer_rad, car.geometry, stop_mps, open_throttle)
    least_n = least_brake_n(state.vx_mps, stop_mps)
    return car.force_scale * max(force_n - LESS_BRAKE_N_PER_M * beyond_m, least_n)
