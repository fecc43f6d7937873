"""The steering: a column with ratio and give, and road wheels that swing behind it.

The steering wheel's angle is given. Behind the ratio a spring carries the moment of the front
tyres around the kingpins, so the wheels give way under side force; dry friction in rack and
joints holds them where they are for small moments.
"""

from sim_bridge.plant.car_parts import SteeringParameters
from sim_bridge.plant.jit import compiled


@compiled
def kingpin_nm(aligning_nm: float, left_n: float, steering: SteeringParameters) -> float:
    """Moment of both front tyres that turns the wheels to the left.

    The caster lets the side force, in the wheels' own axes, turn them out of the bend.
    """
    return aligning_nm - steering.caster_trail_m * left_n


@compiled
def steering_radps2(
    steer_rad: float,
    road_wheel_rad: float,
    road_wheel_rate_radps: float,
    tyres_nm: float,
    steering: SteeringParameters,
) -> float:
    """Angular acceleration of the road wheels, dry friction apart."""
    wound_rad = steer_rad / steering.ratio - road_wheel_rad
    return (
        steering.stiffness_nmprad * wound_rad
        - steering.damping_nms * road_wheel_rate_radps
        + tyres_nm
    ) / steering.inertia_kgm2
