"""The rigid body: planar motion of the whole car, and heave, roll and pitch of the sprung mass.

Momentum is written for the centre of gravity of the whole car, so that the planar equations stay
free of roll and pitch accelerations; the running gear moves a little faster than that point while
the sprung mass sways over it (`running_gear_velocity`).
"""

from typing import NamedTuple

from sim_bridge.plant.car_parts import GRAVITY_MPS2, BodyParameters, SuspensionParameters
from sim_bridge.plant.jit import compiled
from sim_bridge.plant.suspension import WheelValues


class PlanarVelocity(NamedTuple):
    """Velocity of a point in the ground plane, body axes."""

    forward_mps: float
    left_mps: float


class SprungAcceleration(NamedTuple):
    """How the sprung mass is accelerated against the ground."""

    heave_mps2: float
    roll_radps2: float
    pitch_radps2: float


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
    """Height of the sprung mass above its pitch axis."""
    return body.sprung_height_m - suspension.pitch_centre_m


@compiled
def running_gear_velocity(
    vx_mps: float,
    vy_mps: float,
    roll_rate_radps: float,
    pitch_rate_radps: float,
    body: BodyParameters,
    suspension: SuspensionParameters,
) -> PlanarVelocity:
    """Velocity of the wheels' frame below the centre of gravity, without yaw."""
    share = body.sprung_mass_kg / body.mass_kg
    return PlanarVelocity(
        vx_mps - share * pitch_arm_m(body, suspension) * pitch_rate_radps,
        vy_mps + share * roll_arm_m(body, suspension) * roll_rate_radps,
    )


@compiled
def sprung_acceleration(
    roll_rad: float,
    pitch_rad: float,
    road_forward_n: float,
    road_left_n: float,
    ax_mps2: float,
    ay_mps2: float,
    lift_n: float,
    corners: WheelValues,
    body: BodyParameters,
    suspension: SuspensionParameters,
) -> SprungAcceleration:
    """Heave, roll and pitch of the sprung mass.

    The wheels hand the horizontal force of the road on, less what accelerates themselves; it works
    at the road, their inertia at their own height. The weight works over the arms that lean.

    Args:
        corners: upward force of springs and arms on the body at each wheel, beyond the weight.
    """
    mass_kg = body.sprung_mass_kg
    unsprung_kg = body.mass_kg - mass_kg
    beyond_share = unsprung_kg / body.mass_kg
    roll_m = roll_arm_m(body, suspension)
    pitch_m = pitch_arm_m(body, suspension)
    below_m = body.sprung_height_m - body.unsprung_height_m
    front_n = corners.front_left + corners.front_right
    rear_n = corners.rear_left + corners.rear_right
    roll_nm = (
        body.sprung_height_m * road_left_n
        - unsprung_kg * ay_mps2 * below_m
        + mass_kg * GRAVITY_MPS2 * roll_m * roll_rad
        + 0.5 * body.track_front_m * (corners.front_left - corners.front_right)
        + 0.5 * body.track_rear_m * (corners.rear_left - corners.rear_right)
    )
    pitch_nm = (
        -body.sprung_height_m * road_forward_n
        + unsprung_kg * ax_mps2 * below_m
        + mass_kg * GRAVITY_MPS2 * pitch_m * pitch_rad
        - body.sprung_front_axle_m * front_n
        + body.sprung_rear_axle_m * rear_n
    )
    return SprungAcceleration(
        (front_n + rear_n + lift_n) / mass_kg,
        roll_nm / (body.sprung_roll_inertia_kgm2 + mass_kg * roll_m * roll_m * beyond_share),
        pitch_nm / (body.sprung_pitch_inertia_kgm2 + mass_kg * pitch_m * pitch_m * beyond_share),
    )
