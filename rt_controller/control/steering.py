"""Steering of a slowly rolling car along its path, by the geometry of the single-track model."""

from math import asin, atan, copysign, cos, sqrt
from typing import NamedTuple

from rt_controller.contract.limits import INPUT_LIMITS, SteeringGeometry
from rt_controller.contract.signals import CurvaturePreview, PathReference, VehicleState
from rt_controller.contract.timing import PERIOD_S

AT_REST_MPS = 0.1
"""below this speed the car stands"""
DECAY_M = 2.5
"""arc length in which a lateral deviation decays by a factor e"""
DAMPING = 1.0
"""damping ratio of the lateral deviation over arc length"""
STEER_PER_M = 2.0
"""largest change of the wheel angle over the distance rolled, rad/m"""
LARGEST_TURN_MPS2 = 5.0
"""lateral acceleration of a steady turn with the wheel; the vehicle accepts more"""
LAG_SHARE = 0.2
"""of the distance from centre of gravity to rear axle, by which the wheel turns later"""
ERROR_TIME_S = 0.5
"""time constant of the estimated errors of the geometry"""
SLOWEST_TURN_MPS = 1.0
"""below it speed and yaw rate say little about the geometry"""
LARGEST_SLIP_RAD, LARGEST_ERROR_PER_M = 0.1, 0.03
LARGEST_BESIDE = 0.7
"""of the distance to the rear axle over the radius: a car of 45 deg sideslip"""
APPROACH_SHARE = 0.5
"""share of the largest curvature that the return from a large deviation may need"""


class TurnError(NamedTuple):
    """By how much the car turns otherwise than its geometry says: tyres, load, wrong numbers."""

    slip_rad: float = 0.0
    """of the rear axle"""
    curvature_per_m: float = 0.0

    def after(
        self, state: VehicleState, wheel_rad: float, geometry: SteeringGeometry
    ) -> "TurnError":
        """The estimate after a period with the wheel at `wheel_rad`."""
        vx_mps = state.vx_mps
        if vx_mps < SLOWEST_TURN_MPS:
            return self
        expected_per_m = geometry.steady_lateral_mps2(vx_mps, wheel_rad) / vx_mps**2
        share = PERIOD_S / ERROR_TIME_S
        slip_rad = (state.vy_mps - geometry.rear_axle_m * state.yaw_rate_radps) / vx_mps
        error_per_m = state.yaw_rate_radps / vx_mps - expected_per_m
        slip_rad = self.slip_rad + share * (slip_rad - self.slip_rad)
        error_per_m = self.curvature_per_m + share * (error_per_m - self.curvature_per_m)
        return TurnError(
            min(max(slip_rad, -LARGEST_SLIP_RAD), LARGEST_SLIP_RAD),
            min(max(error_per_m, -LARGEST_ERROR_PER_M), LARGEST_ERROR_PER_M),
        )


NO_ERROR = TurnError()


def path_curvature_per_m(
    state: VehicleState,
    path: PathReference,
    curvature_per_m: float,
    geometry: SteeringGeometry,
    largest_per_m: float,
    error: TurnError = NO_ERROR,
) -> float:
    """Curvature that leads the centre of gravity back to the path and then along it.

    With the deviation e and the course error chi of the centre of gravity over arc length s,
    e'' + 2 zeta / l e' + e / l^2 = 0 for the decay length l = `DECAY_M`. On a bend the centre of
    gravity moves at the angle asin(rear_axle_m * curvature) to the car's heading, so this is part
    of the wanted heading, and the rear axle moves on a smaller circle; the feedback of the heading
    acts through it on itself, hence the denominator.
    The course towards the path is at most sqrt(kappa |e|): from a larger one the car could not turn
    onto the path with the curvature kappa, a share of `largest_per_m`, without crossing it.
    """
    wanted_per_m = curvature_per_m + 2.0 * path.c2_per_m
    deviation_m = state.ey_m - path.c0_m
    beside = geometry.rear_axle_m * wanted_per_m
    moved_rad = asin(min(max(beside, -LARGEST_BESIDE), LARGEST_BESIDE))
    course_rad = state.epsi_rad + moved_rad - atan(path.c1) + error.slip_rad
    per_m = 2.0 * DAMPING / DECAY_M
    steepest = sqrt(APPROACH_SHARE * largest_per_m * abs(deviation_m))
    approach_rad = min(abs(deviation_m) / (per_m * DECAY_M**2), steepest)
    feedback = per_m * (course_rad + copysign(approach_rad, deviation_m))
    rear_per_m = wanted_per_m / cos(moved_rad)
    return rear_per_m - error.curvature_per_m - feedback / (1.0 + per_m * geometry.rear_axle_m)


def wheel_angle_rad(curvature_per_m: float, vx_mps: float, geometry: SteeringGeometry) -> float:
    """Angle of the steering wheel for a curvature."""
    rolling_mps = max(vx_mps, AT_REST_MPS)
    return geometry.steady_wheel_rad(rolling_mps, curvature_per_m * rolling_mps)


def curvature_to_meet(
    preview: CurvaturePreview,
    delay_m: float,
    vx_mps: float,
    previous_rad: float,
    geometry: SteeringGeometry,
    largest_radps: float = INPUT_LIMITS.rate_per_s.steer_rad,
) -> float:
    """Curvature of the road that the wheel has to turn to now, in 1/m.

    Where the curvature changes suddenly, the wheel that keeps the centre of gravity on the path
    lags by a share of `rear_axle_m`. A wheel with a limited rate is half turned there if it begins
    half the way before that it rolls while turning. Of the places ahead for which it begins now or
    has begun, the farthest one counts; without any it is that at which the input acts, `delay_m`
    ahead.
    """
    rate_per_m = min(STEER_PER_M * vx_mps, largest_radps) / vx_mps
    spacing_m = preview.spacing_m
    ahead = delay_m / spacing_m
    found, lag_m = preview.curvature_at(ahead), LAG_SHARE * geometry.rear_axle_m
    for knot, curvature in enumerate(preview[1:]):
        way_m = abs(wheel_angle_rad(curvature, vx_mps, geometry) - previous_rad) / rate_per_m
        if knot > ahead and 0.5 * way_m - lag_m >= knot * spacing_m - delay_m:
            found = curvature
    return found


def roll_towards(
    wanted_rad: float,
    previous_rad: float,
    vx_mps: float,
    largest_radps: float = INPUT_LIMITS.rate_per_s.steer_rad,
) -> float:
    """The wheel angle of the next period: `wanted_rad` as far as the rolled distance allows.

    The wheel of a car that stands or rolls back stays where it is: noise of the speed does not turn
    it, and backwards the angle for the way forwards would lead away from the path.
    """
    if vx_mps < AT_REST_MPS:
        return previous_rad
    change_rad = min(STEER_PER_M * vx_mps, largest_radps) * PERIOD_S
    return previous_rad + min(max(wanted_rad - previous_rad, -change_rad), change_rad)
