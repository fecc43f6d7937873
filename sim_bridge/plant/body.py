"""The rigid body: planar motion of the whole car; heave, roll and pitch of the sprung mass; air.

The planar equations hold for the centre of gravity of the whole car, so that they contain no roll
or pitch accelerations. The wheels move relative to that point while the sprung mass rolls and
pitches (`running_gear_velocity`).
"""

from math import cos, hypot, sin
from typing import NamedTuple

from rt_controller.contract.physics import GRAVITY_MPS2
from sim_bridge.plant.car_parts import (
    AeroParameters,
    BodyParameters,
    RoadParameters,
    SuspensionParameters,
)
from sim_bridge.plant.jit import compiled


@compiled
def roll_arm_m(body: BodyParameters, suspension: SuspensionParameters) -> float:
    """Height of the sprung mass above its roll axis."""
    wheelbase_m = body.sprung_front_axle_m + body.sprung_rear_axle_m
    axis_m = (
        suspension.roll_centre_front_m * body.sprung_rear_axle_m
        + suspension.roll_centre_rear_m * body.sprung_front_axle_m
    ) / wheelbase_m
    return body.sprung_height_m - axis_m


@compiled
def pitch_arm_m(body: BodyParameters, suspension: SuspensionParameters) -> float:
    """Height of the sprung mass above its pitch axis.

    The axis is where the slopes of the arms of both axles, seen from the side, meet.
    """
    front_m, rear_m = body.sprung_front_axle_m, body.sprung_rear_axle_m
    slopes = suspension.arm_slope_front + suspension.arm_slope_rear
    return body.sprung_height_m - slopes * front_m * rear_m / (front_m + rear_m)


@compiled
def running_gear_velocity(
    vx_mps: float,
    vy_mps: float,
    roll_rate_radps: float,
    pitch_rate_radps: float,
    body: BodyParameters,
    suspension: SuspensionParameters,
) -> tuple[float, float]:
    """Velocity of the wheels' frame below the centre of gravity, without the part from yaw.

    Returns:
        forward and to the left in m/s, body axes.
    """
    share = body.sprung_mass_kg / body.mass_kg
    forward_mps = vx_mps - share * pitch_arm_m(body, suspension) * pitch_rate_radps
    return forward_mps, vy_mps + share * roll_arm_m(body, suspension) * roll_rate_radps


@compiled
def sprung_acceleration(
    roll_rad: float,
    pitch_rad: float,
    road_forward_n: float,
    road_left_n: float,
    ax_mps2: float,
    ay_mps2: float,
    lift_n: float,
    corners_n: tuple[float, float, float, float],
    body: BodyParameters,
    suspension: SuspensionParameters,
) -> tuple[float, float, float]:
    """Heave (m/s^2), roll and pitch acceleration (rad/s^2) of the sprung mass.

    The wheels transfer the horizontal force of the road, less what accelerates the wheels
    themselves: the first acts at the road, the second at the height of the wheel centres. Gravity
    acts on the arms of roll and pitch.

    Args:
        ax_mps2: acceleration less the part that gravity gives on a slope; `ay_mps2` alike.
        corners_n: upward force of springs and arms on the body at each wheel, beyond the weight.
    """
    front_left_n, front_right_n, rear_left_n, rear_right_n = corners_n
    mass_kg = body.sprung_mass_kg
    unsprung_kg = body.mass_kg - mass_kg
    unsprung_share = unsprung_kg / body.mass_kg
    roll_m = roll_arm_m(body, suspension)
    pitch_m = pitch_arm_m(body, suspension)
    below_m = body.sprung_height_m - body.unsprung_height_m
    front_n = front_left_n + front_right_n
    rear_n = rear_left_n + rear_right_n
    roll_nm = (
        body.sprung_height_m * road_left_n
        - unsprung_kg * ay_mps2 * below_m
        + mass_kg * GRAVITY_MPS2 * roll_m * roll_rad
        + 0.5 * body.track_front_m * (front_left_n - front_right_n)
        + 0.5 * body.track_rear_m * (rear_left_n - rear_right_n)
    )
    pitch_nm = (
        -body.sprung_height_m * road_forward_n
        + unsprung_kg * ax_mps2 * below_m
        + mass_kg * GRAVITY_MPS2 * pitch_m * pitch_rad
        - body.sprung_front_axle_m * front_n
        + body.sprung_rear_axle_m * rear_n
    )
    return (
        (front_n + rear_n + lift_n) / mass_kg,
        roll_nm / (body.sprung_roll_inertia_kgm2 + mass_kg * roll_m * roll_m * unsprung_share),
        pitch_nm / (body.sprung_pitch_inertia_kgm2 + mass_kg * pitch_m * pitch_m * unsprung_share),
    )


class RoadGravity(NamedTuple):
    """What a slope makes of gravity in the axes of the road; all zero on a flat road."""

    forward_mps2: float
    left_mps2: float
    lighter_mps2: float
    """by which gravity against the road is smaller than on a flat road"""


@compiled
def gravity_in_road_axes(road: RoadParameters) -> RoadGravity:
    """Gravity along a car that follows the road."""
    level = cos(road.grade_rad)
    return RoadGravity(
        -GRAVITY_MPS2 * sin(road.grade_rad),
        -GRAVITY_MPS2 * level * sin(road.bank_rad),
        GRAVITY_MPS2 * (1.0 - level * cos(road.bank_rad)),
    )


class AirForce(NamedTuple):
    """Force of the air on the body in its axes, and its moment around the vertical."""

    forward_n: float
    left_n: float
    up_n: float
    yaw_nm: float


@compiled
def air_force(vx_mps: float, vy_mps: float, road: RoadParameters, aero: AeroParameters) -> AirForce:
    """Forces from the velocity of the car against the air, which moves with the wind.

    Drag acts along the car, the side force in proportion to the direction of the flow: both grow
    with the whole speed of the flow.
    """
    forward_mps = vx_mps - road.wind_forward_mps
    left_mps = vy_mps - road.wind_left_mps
    speed_mps = hypot(forward_mps, left_mps)
    per_mps2 = 0.5 * aero.air_density_kgpm3 * aero.area_m2
    side_n = -per_mps2 * aero.side_force_slope * left_mps * speed_mps
    return AirForce(
        -per_mps2 * aero.drag * forward_mps * speed_mps,
        side_n,
        per_mps2 * aero.lift * forward_mps * forward_mps,
        side_n * aero.side_force_ahead_m,
    )
