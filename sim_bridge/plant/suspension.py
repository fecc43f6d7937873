"""Springs, dampers, bars and arms between body and wheels, and the load on each tyre.

Everything is counted from the car at rest, where springs and tyres carry the weight.
"""

from typing import NamedTuple

from numpy import float64
from numpy.typing import NDArray

from sim_bridge.plant.car_parts import (
    GRAVITY_MPS2,
    BodyParameters,
    SuspensionParameters,
    TyreParameters,
)
from sim_bridge.plant.jit import compiled
from sim_bridge.plant.states import AT


class WheelValues(NamedTuple):
    """One number for each wheel."""

    front_left: float
    front_right: float
    rear_left: float
    rear_right: float


class AxleValues(NamedTuple):
    """One number for each axle."""

    front: float
    rear: float


@compiled
def travels_m(state: NDArray[float64], body: BodyParameters) -> WheelValues:
    """How far each wheel has moved up towards the body."""
    front_m = state[AT.heave_m] - body.sprung_front_axle_m * state[AT.pitch_rad]
    rear_m = state[AT.heave_m] + body.sprung_rear_axle_m * state[AT.pitch_rad]
    side_front_m = 0.5 * body.track_front_m * state[AT.roll_rad]
    side_rear_m = 0.5 * body.track_rear_m * state[AT.roll_rad]
    return WheelValues(
        state[AT.rise_m] - front_m - side_front_m,
        state[AT.rise_m + 1] - front_m + side_front_m,
        state[AT.rise_m + 2] - rear_m - side_rear_m,
        state[AT.rise_m + 3] - rear_m + side_rear_m,
    )


@compiled
def travel_rates_mps(state: NDArray[float64], body: BodyParameters) -> WheelValues:
    """How fast each wheel moves up towards the body."""
    front_mps = state[AT.heave_rate_mps] - body.sprung_front_axle_m * state[AT.pitch_rate_radps]
    rear_mps = state[AT.heave_rate_mps] + body.sprung_rear_axle_m * state[AT.pitch_rate_radps]
    side_front_mps = 0.5 * body.track_front_m * state[AT.roll_rate_radps]
    side_rear_mps = 0.5 * body.track_rear_m * state[AT.roll_rate_radps]
    return WheelValues(
        state[AT.rise_rate_mps] - front_mps - side_front_mps,
        state[AT.rise_rate_mps + 1] - front_mps + side_front_mps,
        state[AT.rise_rate_mps + 2] - rear_mps - side_rear_mps,
        state[AT.rise_rate_mps + 3] - rear_mps + side_rear_mps,
    )


@compiled
def axle_roll_rad(travels: WheelValues, body: BodyParameters) -> AxleValues:
    """Roll of the body against the line through the wheels of each axle."""
    return AxleValues(
        (travels.front_right - travels.front_left) / body.track_front_m,
        (travels.rear_right - travels.rear_left) / body.track_rear_m,
    )


@compiled
def spring_forces(
    travels: WheelValues,
    rates: WheelValues,
    rolls: AxleValues,
    body: BodyParameters,
    suspension: SuspensionParameters,
) -> WheelValues:
    """Upward force of spring, damper and bar on the body at each wheel."""
    bar_front_n = suspension.bar_front_nmprad * rolls.front / body.track_front_m
    bar_rear_n = suspension.bar_rear_nmprad * rolls.rear / body.track_rear_m
    return WheelValues(
        _front_n(travels.front_left, rates.front_left, suspension) - bar_front_n,
        _front_n(travels.front_right, rates.front_right, suspension) + bar_front_n,
        _rear_n(travels.rear_left, rates.rear_left, suspension) - bar_rear_n,
        _rear_n(travels.rear_right, rates.rear_right, suspension) + bar_rear_n,
    )


@compiled
def _front_n(travel_m: float, rate_mps: float, suspension: SuspensionParameters) -> float:
    damping = suspension.jounce_front_nspm if rate_mps > 0.0 else suspension.rebound_front_nspm
    return suspension.spring_front_npm * travel_m + damping * rate_mps


@compiled
def _rear_n(travel_m: float, rate_mps: float, suspension: SuspensionParameters) -> float:
    damping = suspension.jounce_rear_nspm if rate_mps > 0.0 else suspension.rebound_rear_nspm
    return suspension.spring_rear_npm * travel_m + damping * rate_mps


@compiled
def rest_loads_n(body: BodyParameters) -> AxleValues:
    """Load of one tyre of each axle with the car at rest."""
    wheelbase_m = body.sprung_front_axle_m + body.sprung_rear_axle_m
    front_kg = body.sprung_mass_kg * body.sprung_rear_axle_m / wheelbase_m
    rear_kg = body.sprung_mass_kg - front_kg
    return AxleValues(
        0.5 * GRAVITY_MPS2 * (front_kg + body.unsprung_front_kg),
        0.5 * GRAVITY_MPS2 * (rear_kg + body.unsprung_rear_kg),
    )


@compiled
def tyre_loads_n(
    state: NDArray[float64], body: BodyParameters, tyre: TyreParameters
) -> WheelValues:
    """Vertical load of each tyre from its own give; a tyre can leave the road, never pull on it."""
    rest = rest_loads_n(body)
    return WheelValues(
        _load_n(rest.front, state[AT.rise_m], state[AT.rise_rate_mps], tyre),
        _load_n(rest.front, state[AT.rise_m + 1], state[AT.rise_rate_mps + 1], tyre),
        _load_n(rest.rear, state[AT.rise_m + 2], state[AT.rise_rate_mps + 2], tyre),
        _load_n(rest.rear, state[AT.rise_m + 3], state[AT.rise_rate_mps + 3], tyre),
    )


@compiled
def _load_n(rest_n: float, rise_m: float, rise_rate_mps: float, tyre: TyreParameters) -> float:
    give_n = tyre.vertical_stiffness_npm * rise_m + tyre.vertical_damping_nspm * rise_rate_mps
    return max(0.0, rest_n - give_n)


@compiled
def arm_forces(
    forward: WheelValues,
    left: WheelValues,
    ax_mps2: float,
    ay_mps2: float,
    body: BodyParameters,
    suspension: SuspensionParameters,
) -> WheelValues:
    """Upward force of the arms on the body at each wheel: what passes beside the springs.

    Arms that slope from the wheel to a centre above the road turn part of a horizontal force into
    a vertical one. The force of the tyre works at the road, the inertia of the wheel at its own
    height above the road; both meet the body in its roll centre, as with a rigid axle.

    Args:
        forward: force of the road on each wheel, body axes.
        left: the same to the left.
    """
    slope_front = 2.0 / body.track_front_m
    slope_rear = 2.0 / body.track_rear_m
    front_kg = 0.5 * body.unsprung_front_kg
    rear_kg = 0.5 * body.unsprung_rear_kg
    centre_front_m = suspension.roll_centre_front_m
    centre_rear_m = suspension.roll_centre_rear_m
    inertia_front_nm = front_kg * ay_mps2 * (centre_front_m - body.unsprung_height_m)
    inertia_rear_nm = rear_kg * ay_mps2 * (centre_rear_m - body.unsprung_height_m)
    dive = suspension.pitch_centre_m / body.sprung_front_axle_m
    squat = suspension.pitch_centre_m / body.sprung_rear_axle_m
    return WheelValues(
        -slope_front * (centre_front_m * left.front_left - inertia_front_nm)
        - dive * (forward.front_left - front_kg * ax_mps2),
        slope_front * (centre_front_m * left.front_right - inertia_front_nm)
        - dive * (forward.front_right - front_kg * ax_mps2),
        -slope_rear * (centre_rear_m * left.rear_left - inertia_rear_nm)
        + squat * (forward.rear_left - rear_kg * ax_mps2),
        slope_rear * (centre_rear_m * left.rear_right - inertia_rear_nm)
        + squat * (forward.rear_right - rear_kg * ax_mps2),
    )
