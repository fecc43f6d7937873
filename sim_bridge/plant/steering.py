"""The steering: a column with ratio and compliance, and the road wheels as an inertia behind it.

The steering wheel angle is given. A spring behind the ratio carries the moment of the front tyres
around the kingpins, so side force turns the road wheels back. Dry friction in rack and joints holds
them against small moments.
"""

from math import atan, sqrt, tan

from sim_bridge.plant.car_parts import SteeringParameters, TyreParameters
from sim_bridge.plant.jit import compiled


@compiled
def kingpin_nm(aligning_nm: float, left_n: float, steering: SteeringParameters) -> float:
    """Moment of a front tyre around its kingpin, positive to the left.

    The side force, in the axes of the wheel, acts behind the kingpin by the caster trail.
    """
    return aligning_nm - steering.caster_trail_m * left_n


@compiled
def ackermann_rad(
    road_wheel_rad: float, side: float, half_track_m: float, wheelbase_m: float, share: float
) -> float:
    """Angle of the left or right front wheel from the mean angle.

    With a share of 1 the axes of all wheels meet in one point; with 0 both wheels are parallel.
    """
    t = tan(road_wheel_rad)
    return atan(t / (1.0 - share * side * half_track_m / wheelbase_m * t))


@compiled
def parking_nm(
    twist_rad: float, load_n: float, road_friction: float, tyre: TyreParameters
) -> float:
    """Moment of one tyre against turning on the spot, from the twist of its contact patch.

    At full twist it grows with the friction, and with load to the power of 1.5, since the contact
    grows with the load.
    """
    share = twist_rad / tyre.parking_twist_rad
    relative = max(0.0, load_n) / tyre.reference_load_n
    return -road_friction * tyre.parking_torque_nm * share * relative * sqrt(relative)


@compiled
def twist_decay_per_s(turn_radps: float, forward_mps: float, tyre: TyreParameters) -> float:
    """How fast a contact patch untwists: it slides at full twist, and rolling renews it.

    With this decay and the turning rate as input the twist never exceeds `parking_twist_rad`.
    """
    sliding = abs(turn_radps) / tyre.parking_twist_rad
    return sliding + abs(forward_mps) / tyre.parking_length_m


@compiled
def hand_torque_nm(steer_rad: float, road_wheel_rad: float, steering: SteeringParameters) -> float:
    """Torque at the steering wheel without power assistance, positive to the left."""
    wound_rad = steer_rad / steering.ratio - road_wheel_rad
    return steering.stiffness_nmprad * wound_rad / steering.ratio


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
