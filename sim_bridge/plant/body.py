"""The rigid body: planar motion of the whole car, and heave, roll and pitch of the sprung mass.

Momentum is written for the centre of gravity of the whole car, so that the planar equations stay
free of roll and pitch accelerations; the running gear moves a little faster than that point while
the sprung mass sways over it (`running_gear_velocity`).
"""

from typing import NamedTuple

from sim_bridge.plant.jit import compiled
from sim_bridge.plant.parameters import GRAVITY_MPS2, BodyParameters, SuspensionParameters
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
    ax_mps2: float,
    ay_mps2: float,
    lift_n: float,
    corners: WheelValues,
    body: BodyParameters,
    suspension: SuspensionParameters,
) -> SprungAcceleration:
    """Heave, roll and pitch under inertia, gravity over the tilted arms, and corner forces."""
    mass_kg = body.sprung_mass_kg
    beyond_share = 1.0 - mass_kg / body.mass_kg
    roll_m = roll_arm_m(body, suspension)
    pitch_m = pitch_arm_m(body, suspension)
    left_n = corners.front_left + corners.rear_left
    right_n = corners.front_right + corners.rear_right
    front_n = corners.front_left + corners.front_right
    rear_n = corners.rear_left + corners.rear_right
    sway_nm = mass_kg * roll_m * (ay_mps2 + GRAVITY_MPS2 * roll_rad)
    roll_nm = sway_nm + 0.5 * body.track_m * (left_n - right_n)
    pitch_nm = (
        mass_kg * pitch_m * (GRAVITY_MPS2 * pitch_rad - ax_mps2)
        - body.sprung_front_axle_m * front_n
        + body.sprung_rear_axle_m * rear_n
    )
    return SprungAcceleration(
        (left_n + right_n + lift_n) / mass_kg,
        roll_nm / (body.sprung_roll_inertia_kgm2 + mass_kg * roll_m * roll_m * beyond_share),
        pitch_nm / (body.sprung_pitch_inertia_kgm2 + mass_kg * pitch_m * pitch_m * beyond_share),
    )
