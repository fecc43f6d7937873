"""Springs, dampers, anti-roll bars and arms between body and wheels, and the load on each tyre.

All forces and displacements are counted from the car at rest, where springs and tyres carry the
weight.
"""

from rt_controller.contract.arrays import Array
from sim_bridge.plant.axles import Axle
from sim_bridge.plant.car_parts import BodyParameters, SuspensionParameters, TyreParameters
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
    """Upward force of spring, damper and anti-roll bar on the body at one wheel.

    Args:
        roll_rad: of the body against the axle.
    """
    body_mps = state[AT.heave_rate_mps] - axle.sprung_ahead_m * state[AT.pitch_rate_radps]
    lateral_m = side_of(wheel) * axle.half_track_m
    rate_mps = state[AT.rise_rate_mps + wheel] - body_mps - lateral_m * state[AT.roll_rate_radps]
    damping_nspm = axle.jounce_nspm if rate_mps > 0.0 else axle.rebound_nspm
    bar_n = side_of(wheel) * axle.bar_nmprad * roll_rad / axle.track_m
    return float(axle.spring_npm * travel_m(state, wheel, axle) + damping_nspm * rate_mps - bar_n)


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
    ax_mps2: float,
    ay_mps2: float,
    axle: Axle,
    body: BodyParameters,
    suspension: SuspensionParameters,
) -> float:
    """Upward force of the suspension arms on the body at one wheel.

    Inclined arms convert a part of a horizontal force into a vertical one. The force of the tyre
    acts at the road, the inertia force of the wheel at the height of its centre; both are
    transferred to the body in the roll centre, as with a rigid axle.

    Args:
        forward_n: force of the road on the wheel, body axes.
        left_n: the same to the left.
    """
    lateral_nm = axle.roll_centre_m * left_n - axle.wheel_kg * ay_mps2 * (
        axle.roll_centre_m - body.unsprung_height_m
    )
    slope_per_m = side_of(wheel) * 2.0 / axle.track_m
    pitch_slope = suspension.pitch_centre_m / axle.sprung_ahead_m
    return -slope_per_m * lateral_nm - pitch_slope * (forward_n - axle.wheel_kg * ax_mps2)
