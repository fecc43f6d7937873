"""The whole car as one function of state, inputs and parameters: x' = f(x, u, p).

`evaluate` leaves the answer in the three arrays of `Derivative`: most states have a plain rate,
lags are kept as rate and decay so that a step can solve them exactly, and what turns against dry
friction carries it apart, so that it may be stopped but never turned round.
"""

from math import cos, pi, sin
from typing import NamedTuple

from numpy import float64
from numpy.typing import NDArray

from sim_bridge.plant import aero, body, brakes, driveline, powertrain, steering, suspension, tyres
from sim_bridge.plant.jit import compiled
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.states import AT, N_FRONT
from sim_bridge.plant.suspension import AxleValues, WheelValues

_LARGEST_SLIP = 3.0
_LARGEST_TILT_RAD = 0.5 * pi


class Derivative(NamedTuple):
    """How a state moves: x' = rate - decay x, and dry friction of size `friction` against x.

    Three arrays of `N_STATES` entries each.
    """

    rate: NDArray[float64]
    decay: NDArray[float64]
    friction: NDArray[float64]


class WheelForce(NamedTuple):
    """Force of the road on one wheel in body axes, and its moments around the vertical."""

    forward_n: float
    left_n: float
    aligning_nm: float
    kingpin_nm: float


class WheelPlace(NamedTuple):
    """How one wheel stands on the road."""

    forward_mps: float
    """velocity of the contact, body axes"""
    left_mps: float
    angle_rad: float
    """to the left, against the body"""
    lean_rad: float
    """to the right, against the ground"""
    load_n: float
    friction: float
    """of the road"""


@compiled
def evaluate(
    state: NDArray[float64],
    throttle: float,
    brake_n: float,
    steer_rad: float,
    p: Parameters,
    out: Derivative,
) -> WheelValues:
    """Fill `out` with the motion of `state` under held inputs; returns the wheel loads in N."""
    yaw_rate = state[AT.yaw_rate_radps]
    travels = suspension.travels_m(state, p.body)
    rolls = suspension.axle_roll_rad(travels, p.body)
    springs = suspension.spring_forces(
        travels, suspension.travel_rates_mps(state, p.body), rolls, p.body, p.suspension
    )
    loads = suspension.tyre_loads_n(state, p.body, p.tyre)
    _brake(state, brake_n, p, out)
    drive = powertrain.drive(state, throttle, p, out.rate, out.decay)

    fl, fr, rl, rr = _wheels(state, travels, rolls, loads, drive, p, out)
    left_n = fl.left_n + fr.left_n + rl.left_n + rr.left_n
    forward_n = fl.forward_n + fr.forward_n + rl.forward_n + rr.forward_n
    air = aero.air_force(state[AT.vx_mps], p.aero)
    ax_mps2 = (forward_n + air.forward_n) / p.body.mass_kg
    ay_mps2 = left_n / p.body.mass_kg
    yaw_nm = (
        p.body.front_axle_m * (fl.left_n + fr.left_n)
        - p.body.rear_axle_m * (rl.left_n + rr.left_n)
        + 0.5 * p.body.track_front_m * (fr.forward_n - fl.forward_n)
        + 0.5 * p.body.track_rear_m * (rr.forward_n - rl.forward_n)
        + fl.aligning_nm + fr.aligning_nm + rl.aligning_nm + rr.aligning_nm
    )  # fmt: skip
    out.rate[AT.vx_mps] = ax_mps2 + yaw_rate * state[AT.vy_mps]
    out.rate[AT.vy_mps] = ay_mps2 - yaw_rate * state[AT.vx_mps]
    out.rate[AT.yaw_rate_radps] = yaw_nm / p.body.yaw_inertia_kgm2

    arms = suspension.arm_forces(
        WheelValues(fl.forward_n, fr.forward_n, rl.forward_n, rr.forward_n),
        WheelValues(fl.left_n, fr.left_n, rl.left_n, rr.left_n),
        ax_mps2,
        ay_mps2,
        p.body,
        p.suspension,
    )
    corners = WheelValues(
        springs.front_left + arms.front_left,
        springs.front_right + arms.front_right,
        springs.rear_left + arms.rear_left,
        springs.rear_right + arms.rear_right,
    )
    sprung = body.sprung_acceleration(
        state[AT.roll_rad], state[AT.pitch_rad], forward_n, left_n, ax_mps2, ay_mps2, air.up_n,
        corners, p.body, p.suspension,
    )  # fmt: skip
    out.rate[AT.heave_m] = state[AT.heave_rate_mps]
    out.rate[AT.heave_rate_mps] = sprung.heave_mps2
    out.rate[AT.roll_rad] = state[AT.roll_rate_radps]
    out.rate[AT.roll_rate_radps] = sprung.roll_radps2
    out.rate[AT.pitch_rad] = state[AT.pitch_rate_radps]
    out.rate[AT.pitch_rate_radps] = sprung.pitch_radps2
    _rise(state, loads, corners, p, out)

    out.rate[AT.road_wheel_rad] = state[AT.road_wheel_rate_radps]
    out.rate[AT.road_wheel_rate_radps] = steering.steering_radps2(
        steer_rad,
        state[AT.road_wheel_rad],
        state[AT.road_wheel_rate_radps],
        fl.kingpin_nm + fr.kingpin_nm,
        p.steering,
    )
    out.friction[AT.road_wheel_rate_radps] = p.steering.friction_nm / p.steering.inertia_kgm2
    return loads


@compiled
def _brake(state: NDArray[float64], brake_n: float, p: Parameters, out: Derivative) -> None:
    """The pressures tend to what the pedal asks for."""
    front_mpa = brakes.front_pressure_mpa(brake_n, p.brakes)
    rear_mpa = brakes.rear_pressure_mpa(front_mpa, p.brakes)
    for wheel in range(4):
        asked_mpa = front_mpa if wheel < N_FRONT else rear_mpa
        out.rate[AT.brake_mpa + wheel] = asked_mpa / p.brakes.lag_s
        out.decay[AT.brake_mpa + wheel] = 1.0 / p.brakes.lag_s


@compiled
def _rise(
    state: NDArray[float64],
    loads: WheelValues,
    corners: WheelValues,
    p: Parameters,
    out: Derivative,
) -> None:
    """The wheels move up and down between the road and what they carry."""
    rest = suspension.rest_loads_n(p.body)
    front_kg = 0.5 * p.body.unsprung_front_kg
    rear_kg = 0.5 * p.body.unsprung_rear_kg
    for wheel in range(4):
        out.rate[AT.rise_m + wheel] = state[AT.rise_rate_mps + wheel]
    first = AT.rise_rate_mps
    out.rate[first] = (loads.front_left - rest.front - corners.front_left) / front_kg
    out.rate[first + 1] = (loads.front_right - rest.front - corners.front_right) / front_kg
    out.rate[first + 2] = (loads.rear_left - rest.rear - corners.rear_left) / rear_kg
    out.rate[first + 3] = (loads.rear_right - rest.rear - corners.rear_right) / rear_kg


@compiled
def _wheels(
    state: NDArray[float64],
    travels: WheelValues,
    rolls: AxleValues,
    loads: WheelValues,
    drive: driveline.AxleTorque,
    p: Parameters,
    out: Derivative,
) -> tuple[WheelForce, WheelForce, WheelForce, WheelForce]:
    """What the road does to the four wheels; their slips and spins go into `out`."""
    yaw_rate = state[AT.yaw_rate_radps]
    roll_rad = state[AT.roll_rad]
    frame = body.running_gear_velocity(
        state[AT.vx_mps],
        state[AT.vy_mps],
        state[AT.roll_rate_radps],
        state[AT.pitch_rate_radps],
        p.body,
        p.suspension,
    )
    front_turn_mps = 0.5 * p.body.track_front_m * yaw_rate
    rear_turn_mps = 0.5 * p.body.track_rear_m * yaw_rate
    front_left_mps = frame.left_mps + p.body.front_axle_m * yaw_rate
    rear_left_mps = frame.left_mps - p.body.rear_axle_m * yaw_rate
    front_rad = state[AT.road_wheel_rad] + p.suspension.roll_steer_front * rolls.front
    rear_rad = p.suspension.roll_steer_rear * rolls.rear
    # Travel takes back what of the body's roll the wheels do not follow.
    stay_front = 2.0 * (1.0 - p.suspension.camber_gain_front) / p.body.track_front_m
    stay_rear = 2.0 * (1.0 - p.suspension.camber_gain_rear) / p.body.track_rear_m
    fl = _wheel(
        state, 0, drive.front_wheel_nm, p.brakes.front_nm_per_mpa,
        WheelPlace(
            frame.forward_mps - front_turn_mps, front_left_mps, front_rad,
            roll_rad + stay_front * travels.front_left, loads.front_left, p.road.friction_left,
        ),
        p, out,
    )  # fmt: skip
    fr = _wheel(
        state, 1, drive.front_wheel_nm, p.brakes.front_nm_per_mpa,
        WheelPlace(
            frame.forward_mps + front_turn_mps, front_left_mps, front_rad,
            roll_rad - stay_front * travels.front_right, loads.front_right, p.road.friction_right,
        ),
        p, out,
    )  # fmt: skip
    rl = _wheel(
        state, 2, drive.rear_wheel_nm, p.brakes.rear_nm_per_mpa,
        WheelPlace(
            frame.forward_mps - rear_turn_mps, rear_left_mps, rear_rad,
            roll_rad + stay_rear * travels.rear_left, loads.rear_left, p.road.friction_left,
        ),
        p, out,
    )  # fmt: skip
    rr = _wheel(
        state, 3, drive.rear_wheel_nm, p.brakes.rear_nm_per_mpa,
        WheelPlace(
            frame.forward_mps + rear_turn_mps, rear_left_mps, rear_rad,
            roll_rad - stay_rear * travels.rear_right, loads.rear_right, p.road.friction_right,
        ),
        p, out,
    )  # fmt: skip
    return fl, fr, rl, rr


@compiled
def _wheel(
    state: NDArray[float64],
    wheel: int,
    drive_nm: float,
    brake_nm_per_mpa: float,
    place: WheelPlace,
    p: Parameters,
    out: Derivative,
) -> WheelForce:
    """One wheel: slips and spin into `out`, its force back in body axes."""
    spin = state[AT.spin_radps + wheel]
    lateral_slip = state[AT.lateral_slip + wheel]
    longitudinal_slip = state[AT.longitudinal_slip + wheel]
    c = cos(place.angle_rad)
    s = sin(place.angle_rad)
    forward_mps = c * place.forward_mps + s * place.left_mps
    left_mps = c * place.left_mps - s * place.forward_mps
    radius_m = p.tyre.rolling_radius_m

    across = tyres.lateral_relaxation(lateral_slip, forward_mps, left_mps, place.load_n, p.tyre)
    along = tyres.longitudinal_relaxation(
        longitudinal_slip, forward_mps, spin * radius_m, place.load_n, p.tyre
    )
    road = tyres.force(
        lateral_slip + across.damping,
        longitudinal_slip + along.damping,
        place.lean_rad,
        place.load_n,
        place.friction,
        p.tyre,
    )
    out.rate[AT.lateral_slip + wheel] = across.rate
    out.decay[AT.lateral_slip + wheel] = across.decay
    out.rate[AT.longitudinal_slip + wheel] = along.rate
    out.decay[AT.longitudinal_slip + wheel] = along.decay
    out.rate[AT.spin_radps + wheel] = (
        drive_nm - radius_m * road.forward_n
    ) / p.tyre.spin_inertia_kgm2
    out.friction[AT.spin_radps + wheel] = (
        brake_nm_per_mpa * max(0.0, state[AT.brake_mpa + wheel])
        + tyres.rolling_resistance_nm(spin, place.load_n, p.tyre)
    ) / p.tyre.spin_inertia_kgm2
    return WheelForce(
        c * road.forward_n - s * road.left_n,
        s * road.forward_n + c * road.left_n,
        road.aligning_nm,
        steering.kingpin_nm(road.aligning_nm, road.left_n, p.steering),
    )


@compiled
def bound(state: NDArray[float64]) -> None:
    """Keep states where they still mean something.

    A standing wheel would wind its slip up forever; a car that has rolled over stays on its side.
    """
    for i in range(AT.lateral_slip, AT.longitudinal_slip + 4):
        state[i] = min(_LARGEST_SLIP, max(-_LARGEST_SLIP, state[i]))
    _stop_at(state, AT.roll_rad, AT.roll_rate_radps)
    _stop_at(state, AT.pitch_rad, AT.pitch_rate_radps)


@compiled
def _stop_at(state: NDArray[float64], angle: int, rate: int) -> None:
    if abs(state[angle]) > _LARGEST_TILT_RAD:
        state[angle] = min(_LARGEST_TILT_RAD, max(-_LARGEST_TILT_RAD, state[angle]))
        state[rate] = 0.0
