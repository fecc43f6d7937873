"""`Payload`: a load in the car, as a point mass in its plane of symmetry."""

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from sim_bridge.plant.parameters import Parameters


class Payload(NamedTuple):
    """A mass that is added to the body of the car."""

    mass_kg: float = 0.0
    ahead_m: float = 0.0
    """of the centre of gravity of the car without it; negative: behind"""
    height_m: float = 0.6
    """above the ground"""


NO_PAYLOAD = Payload()


def with_payload(parameters: "Parameters", payload: Payload) -> "Parameters":
    """The same car with a load: masses, centres of gravity and moments of inertia change."""
    body, load_kg = parameters.body, payload.mass_kg
    if load_kg == 0.0:
        return parameters
    mass_kg = body.mass_kg + load_kg
    forward_m = load_kg * payload.ahead_m / mass_kg
    sprung_kg = body.sprung_mass_kg + load_kg
    ahead_of_sprung_m = payload.ahead_m + body.sprung_front_axle_m - body.front_axle_m
    sprung_forward_m = load_kg * ahead_of_sprung_m / sprung_kg
    height_m = (body.sprung_mass_kg * body.sprung_height_m + load_kg * payload.height_m) / sprung_kg
    # Parallel axes: both masses move against the new centre of gravity.
    vertical_kgm2 = (
        body.sprung_mass_kg * (height_m - body.sprung_height_m) ** 2
        + load_kg * (payload.height_m - height_m) ** 2
    )
    along_kgm2 = (
        body.sprung_mass_kg * sprung_forward_m**2
        + load_kg * (ahead_of_sprung_m - sprung_forward_m) ** 2
    )
    yaw_kgm2 = body.mass_kg * forward_m**2 + load_kg * (payload.ahead_m - forward_m) ** 2
    loaded = body._replace(
        mass_kg=mass_kg,
        yaw_inertia_kgm2=body.yaw_inertia_kgm2 + yaw_kgm2,
        front_axle_m=body.front_axle_m - forward_m,
        rear_axle_m=body.rear_axle_m + forward_m,
        sprung_mass_kg=sprung_kg,
        sprung_roll_inertia_kgm2=body.sprung_roll_inertia_kgm2 + vertical_kgm2,
        sprung_pitch_inertia_kgm2=body.sprung_pitch_inertia_kgm2 + vertical_kgm2 + along_kgm2,
        sprung_front_axle_m=body.sprung_front_axle_m - sprung_forward_m,
        sprung_rear_axle_m=body.sprung_rear_axle_m + sprung_forward_m,
        sprung_height_m=height_m,
    )
    return parameters._replace(body=loaded)
