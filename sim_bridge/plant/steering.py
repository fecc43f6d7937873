"""The steering: a column with ratio and compliance, and the road wheels as an inertia behind it.

The steering wheel angle is given. A spring behind the ratio carries the moment of the front tyres
around the kingpins, so side force turns the road wheels back. Dry friction in rack and joints holds
them against small moments.
"""

from sim_bridge.plant.car_parts import SteeringParameters
from sim_bridge.plant.jit import compiled


@compiled
def kingpin_nm(aligning_nm: float, left_n: float, steering: SteeringParameters) -> float:
    """Moment of a front tyre around its kingpin, positive to the left.

    The side force, in the axes of the wheel, acts behind the kingpin by the caster trail.
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
    """Angular acceleration of the road wheels without dry friction."""
    wound_rad = steer_rad / steering.ratio - road_wheel_rad
    return (
        steering.stiffness_nmprad * wound_rad
        - steering.damping_nms * road_wheel_rate_radps
        + tyres_nm
    ) / steering.inertia_kgm2
