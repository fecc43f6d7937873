"""Springs, dampers and bars: what carries the sprung mass, and the load it leaves on each tyre."""

from typing import NamedTuple

from sim_bridge.plant.jit import compiled
from sim_bridge.plant.parameters import GRAVITY_MPS2, BodyParameters, SuspensionParameters


class WheelValues(NamedTuple):
    """One number for each wheel."""

    front_left: float
    front_right: float
    rear_left: float
    rear_right: float


@compiled
def _corner_n(
    compression_m: float, speed_mps: float, rate_npm: float, jounce_nspm: float, rebound_nspm: float
) -> float:
    damping_nspm = jounce_nspm if speed_mps > 0.0 else rebound_nspm
    return rate_npm * compression_m + damping_nspm * speed_mps


@compiled
def corner_forces(
    heave_m: float,
    heave_rate_mps: float,
    roll_rad: float,
    roll_rate_radps: float,
    pitch_rad: float,
    pitch_rate_radps: float,
    body: BodyParameters,
    suspension: SuspensionParameters,
) -> WheelValues:
    """Upward force of each corner on the sprung mass, beyond its share of the weight at rest."""
    half_m = 0.5 * body.track_m
    front_m = -heave_m + body.sprung_front_axle_m * pitch_rad
    front_mps = -heave_rate_mps + body.sprung_front_axle_m * pitch_rate_radps
    rear_m = -heave_m - body.sprung_rear_axle_m * pitch_rad
    rear_mps = -heave_rate_mps - body.sprung_rear_axle_m * pitch_rate_radps
    side_m = half_m * roll_rad
    side_mps = half_m * roll_rate_radps
    bar_front_n = suspension.bar_front_nmprad * roll_rad / body.track_m
    bar_rear_n = suspension.bar_rear_nmprad * roll_rad / body.track_m
    return WheelValues(
        _corner_n(
            front_m - side_m,
            front_mps - side_mps,
            suspension.ride_rate_front_npm,
            suspension.jounce_front_nspm,
            suspension.rebound_front_nspm,
        )
        - bar_front_n,
        _corner_n(
            front_m + side_m,
            front_mps + side_mps,
            suspension.ride_rate_front_npm,
            suspension.jounce_front_nspm,
            suspension.rebound_front_nspm,
        )
        + bar_front_n,
        _corner_n(
            rear_m - side_m,
            rear_mps - side_mps,
            suspension.ride_rate_rear_npm,
            suspension.jounce_rear_nspm,
            suspension.rebound_rear_nspm,
        )
        - bar_rear_n,
        _corner_n(
            rear_m + side_m,
            rear_mps + side_mps,
            suspension.ride_rate_rear_npm,
            suspension.jounce_rear_nspm,
            suspension.rebound_rear_nspm,
        )
        + bar_rear_n,
    )


@compiled
def wheel_loads(
    corners: WheelValues,
    settled_ax_mps2: float,
    settled_ay_mps2: float,
    body: BodyParameters,
    suspension: SuspensionParameters,
) -> WheelValues:
    """Vertical load of each tyre: weight at rest, springs, and what passes beside the springs.

    Beside the springs go the moments of the unsprung masses and the part of the sprung mass's
    horizontal force that acts at the roll and pitch centres.
    """
    wheelbase_m = body.sprung_front_axle_m + body.sprung_rear_axle_m
    sprung_front_kg = body.sprung_mass_kg * body.sprung_rear_axle_m / wheelbase_m
    sprung_rear_kg = body.sprung_mass_kg - sprung_front_kg
    rest_front_n = 0.5 * GRAVITY_MPS2 * (sprung_front_kg + body.unsprung_front_kg)
    rest_rear_n = 0.5 * GRAVITY_MPS2 * (sprung_rear_kg + body.unsprung_rear_kg)

    across_front_n = (
        settled_ay_mps2
        * (
            sprung_front_kg * suspension.roll_centre_front_m
            + body.unsprung_front_kg * body.unsprung_height_m
        )
        / body.track_m
    )
    across_rear_n = (
        settled_ay_mps2
        * (
            sprung_rear_kg * suspension.roll_centre_rear_m
            + body.unsprung_rear_kg * body.unsprung_height_m
        )
        / body.track_m
    )
    unsprung_kg = body.unsprung_front_kg + body.unsprung_rear_kg
    along_n = (
        0.5
        * settled_ax_mps2
        * (body.sprung_mass_kg * suspension.pitch_centre_m + unsprung_kg * body.unsprung_height_m)
        / wheelbase_m
    )
    return WheelValues(
        max(0.0, rest_front_n + corners.front_left - across_front_n - along_n),
        max(0.0, rest_front_n + corners.front_right + across_front_n - along_n),
        max(0.0, rest_rear_n + corners.rear_left - across_rear_n + along_n),
        max(0.0, rest_rear_n + corners.rear_right + across_rear_n + along_n),
    )
