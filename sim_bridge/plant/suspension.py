"""Springs, dampers, anti-roll bars and arms between body and wheels, and the load on each tyre.

All forces and displacements are counted from the car at rest, where springs and tyres carry the
weight.
"""

from math import sqrt

from rt_controller.contract.arrays import Array
from sim_bridge.plant.axles import Axle
from sim_bridge.plant.car_parts import BodyParameters, TyreParameters
from sim_bridge.plant.jit import compiled
from sim_bridge.plant.states import AT

LEFT, RIGHT = 1.0, -1.0
"""sign of a wheel's lateral position"""


@compiled
def side_of(wheel: int) -> float:
    """LEFT or RIGHT."""
    return LEFT if wheel % 2 == 0 else RIGHT


@compiled
def travel_m(state: Array, wheel: int, axle: Axle) -> float:
    """Displacement of a wheel upward against the body."""
    body_m = state[AT.heave_m] - axle.sprung_ahead_m * state[AT.pitch_rad]
    lateral_m = side_of(wheel) * axle.half_track_m
    return float(state[AT.rise_m + wheel] - body_m - lateral_m * state[AT.roll_rad])


@compiled
def axle_roll_rad(state: Array, left_wheel: int, axle: Axle) -> float:
    """Roll of the body against the line through the wheels of an axle."""
    left_m = travel_m(state, left_wheel, axle)
    return (travel_m(state, left_wheel + 1, axle) - left_m) / axle.track_m


@compiled
def spring_force_n(state: Array, wheel: int, roll_rad: float, axle: Axle) -> float:
    """Upward force of spring, stops, damper and anti-roll bar on the body at one wheel.

    Args:
        roll_rad: of the body against the axle.
    """
    body_mps = state[AT.heave_rate_mps] - axle.sprung_ahead_m * state[AT.pitch_rate_radps]
    lateral_m = side_of(wheel) * axle.half_track_m
    rate_mps = state[AT.rise_rate_mps + wheel] - body_mps - lateral_m * state[AT.roll_rate_radps]
    bar_n = side_of(wheel) * axle.bar_nmprad * roll_rad / axle.track_m
    damper_n = damper_force_n(rate_mps, axle)
    risen_m = travel_m(state, wheel, axle)
    return float(axle.spring_npm * risen_m + stop_force_n(risen_m, axle) + damper_n - bar_n)


@compiled
def stop_force_n(risen_m: float, axle: Axle) -> float:
    """Force of bump stop or rebound stop on the body, square in the travel beyond the gap."""
    beyond_m = abs(risen_m) - axle.stop_gap_m
    if beyond_m <= 0.0:
        return 0.0
    stop_n = axle.stop_npm2 * beyond_m * beyond_m
    return stop_n if risen_m > 0.0 else -stop_n


@compiled
def damper_force_n(rate_mps: float, axle: Axle) -> float:
    """Force of a damper on the body at the wheel; `rate_mps` is positive in jounce.

    Digressive: the slope falls from that of slow motion to that of fast motion around the knee, as
    with valves that open. Equal slopes give a linear damper.
    """
    slow_nspm, fast_nspm = axle.rebound_nspm, axle.rebound_fast_nspm
    if rate_mps > 0.0:
        slow_nspm, fast_nspm = axle.jounce_nspm, axle.jounce_fast_nspm
    relative = rate_mps / axle.damper_knee_mps
    opening_nspm = (slow_nspm - fast_nspm) / sqrt(1.0 + relative * relative)
    return (fast_nspm + opening_nspm) * rate_mps


@compiled
def tyre_load_n(state: Array, wheel: int, axle: Axle, tyre: TyreParameters) -> float:
    """Vertical load of a tyre from its deflection; never negative: the tyre can leave the road."""
    deflection_n: float = (
        tyre.vertical_stiffness_npm * state[AT.rise_m + wheel]
        + tyre.vertical_damping_nspm * state[AT.rise_rate_mps + wheel]
    )
    return max(0.0, axle.rest_load_n - deflection_n)


@compiled
def arm_force_n(
    wheel: int,
    forward_n: float,
    left_n: float,
    drive_n: float,
    ax_mps2: float,
    ay_mps2: float,
    axle: Axle,
    body: BodyParameters,
) -> float:
    """Upward force of the suspension arms on the body at one wheel.

    Inclined arms convert a part of a horizontal force into a vertical one. The force of the tyre
    acts at the road, the inertia force of the wheel at the height of its centre; both are
    transferred to the body in the roll centre, as with a rigid axle. In side view the arms carry
    the torque of the brake, so that its force acts at the road; a drive shaft comes from the body,
    so that its force acts at the wheel centre.

    Args:
        forward_n: force of the road on the wheel, body axes.
        left_n: the same to the left.
        drive_n: torque of the drive shaft over the radius of the wheel.
        ax_mps2: acceleration less the part that gravity gives on a slope.
        ay_mps2: the same to the left.
    """
    lateral_nm = axle.roll_centre_m * left_n - axle.wheel_kg * ay_mps2 * (
        axle.roll_centre_m - body.unsprung_height_m
    )
    slope_per_m = side_of(wheel) * 2.0 / axle.track_m
    return (
        -slope_per_m * lateral_nm
        + axle.arm_slope * (forward_n - drive_n)
        + axle.centre_slope * (drive_n - axle.wheel_kg * ax_mps2)
    )
