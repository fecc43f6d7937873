"""The whole car as one function of state, inputs and parameters: x' = f(x, u, p).

`evaluate` writes its result to the three arrays of `Derivative`. Most states have a plain rate.
First-order lags are given as rate and decay, so that a step can solve them exactly. States with dry
friction have it separately, so that friction can stop a motion but not reverse it.
"""

from math import cos, pi, sin
from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import ControlInput
from sim_bridge.plant import body, brakes, powertrain, steering, suspension, tyres
from sim_bridge.plant.axles import Axle, axles
from sim_bridge.plant.jit import compiled
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.states import AT, N_FRONT, N_STATES, N_WHEELS
from sim_bridge.plant.suspension import LEFT

_LARGEST_SLIP = 3.0
_LARGEST_TILT_RAD = 0.5 * pi


class Derivative(NamedTuple):
    """Derivative of a state: x' = rate - decay x, and dry friction of size `friction` against x.

    Three arrays of `N_STATES` entries each.
    """

    rate: Array
    decay: Array
    friction: Array


@compiled
def new_derivative() -> Derivative:
    """A derivative of zeros, for `evaluate` to write to."""
    return Derivative(np.zeros(N_STATES), np.zeros(N_STATES), np.zeros(N_STATES))


class WheelForce(NamedTuple):
    """Force of the road on one wheel in body axes, and its moments around the vertical."""

    forward_n: float
    left_n: float
    aligning_nm: float
    kingpin_nm: float


@compiled
def evaluate(state: Array, control: ControlInput, p: Parameters, out: Derivative) -> None:
    """Write the derivative of `state` under constant inputs to `out`."""
    yaw_rate = state[AT.yaw_rate_radps]
    front, rear = axles(p)
    front_roll_rad = suspension.axle_roll_rad(state, 0, front)
    rear_roll_rad = suspension.axle_roll_rad(state, N_FRONT, rear)
    _brake(control.brake_n, p, out)
    torque = powertrain.wheel_torque(state, control.throttle, p, out.rate, out.decay)

    front_rad = state[AT.road_wheel_rad] + front.roll_steer * front_roll_rad
    rear_rad = rear.roll_steer * rear_roll_rad
    fl = _wheel(state, 0, front, front_rad, torque.front_wheel_nm, p, out)
    fr = _wheel(state, 1, front, front_rad, torque.front_wheel_nm, p, out)
    rl = _wheel(state, 2, rear, rear_rad, torque.rear_wheel_nm, p, out)
    rr = _wheel(state, 3, rear, rear_rad, torque.rear_wheel_nm, p, out)

    left_n = fl.left_n + fr.left_n + rl.left_n + rr.left_n
    forward_n = fl.forward_n + fr.forward_n + rl.forward_n + rr.forward_n
    air_forward_n, air_up_n = body.air_force(state[AT.vx_mps], p.aero)
    ax_mps2 = (forward_n + air_forward_n) / p.body.mass_kg
    ay_mps2 = left_n / p.body.mass_kg
    yaw_nm = (
        p.body.front_axle_m * (fl.left_n + fr.left_n)
        - p.body.rear_axle_m * (rl.left_n + rr.left_n)
        + front.half_track_m * (fr.forward_n - fl.forward_n)
        + rear.half_track_m * (rr.forward_n - rl.forward_n)
        + fl.aligning_nm + fr.aligning_nm + rl.aligning_nm + rr.aligning_nm
    )  # fmt: skip
    out.rate[AT.vx_mps] = ax_mps2 + yaw_rate * state[AT.vy_mps]
    out.rate[AT.vy_mps] = ay_mps2 - yaw_rate * state[AT.vx_mps]
    out.rate[AT.yaw_rate_radps] = yaw_nm / p.body.yaw_inertia_kgm2

    corners_n = (
        _corner(state, 0, front, front_roll_rad, fl, ax_mps2, ay_mps2, p, out),
        _corner(state, 1, front, front_roll_rad, fr, ax_mps2, ay_mps2, p, out),
        _corner(state, 2, rear, rear_roll_rad, rl, ax_mps2, ay_mps2, p, out),
        _corner(state, 3, rear, rear_roll_rad, rr, ax_mps2, ay_mps2, p, out),
    )
    heave_mps2, roll_radps2, pitch_radps2 = body.sprung_acceleration(
        state[AT.roll_rad], state[AT.pitch_rad], forward_n, left_n, ax_mps2, ay_mps2, air_up_n,
        corners_n, p.body, p.suspension,
    )  # fmt: skip
    out.rate[AT.heave_m] = state[AT.heave_rate_mps]
    out.rate[AT.heave_rate_mps] = heave_mps2
    out.rate[AT.roll_rad] = state[AT.roll_rate_radps]
    out.rate[AT.roll_rate_radps] = roll_radps2
    out.rate[AT.pitch_rad] = state[AT.pitch_rate_radps]
    out.rate[AT.pitch_rate_radps] = pitch_radps2

    out.rate[AT.road_wheel_rad] = state[AT.road_wheel_rate_radps]
    out.rate[AT.road_wheel_rate_radps] = steering.steering_radps2(
        control.steer_rad,
        state[AT.road_wheel_rad],
        state[AT.road_wheel_rate_radps],
        fl.kingpin_nm + fr.kingpin_nm,
        p.steering,
    )
    out.friction[AT.road_wheel_rate_radps] = p.steering.friction_nm / p.steering.inertia_kgm2


@compiled
def _brake(brake_n: float, p: Parameters, out: Derivative) -> None:
    """Lag of the four brake pressures behind the pedal."""
    front_mpa, rear_mpa = brakes.steady_pressures_mpa(brake_n, p.brakes)
    for wheel in range(N_WHEELS):
        steady_mpa = front_mpa if wheel < N_FRONT else rear_mpa
        out.rate[AT.brake_mpa + wheel] = steady_mpa / p.brakes.lag_s
        out.decay[AT.brake_mpa + wheel] = 1.0 / p.brakes.lag_s


@compiled
def _corner(
    state: Array,
    wheel: int,
    axle: Axle,
    axle_roll_rad: float,
    road: WheelForce,
    ax_mps2: float,
    ay_mps2: float,
    p: Parameters,
    out: Derivative,
) -> float:
    """Upward force of one corner on the body; the vertical motion of its wheel goes into `out`."""
    spring_n = suspension.spring_force_n(state, wheel, axle_roll_rad, axle)
    corner_n = spring_n + suspension.arm_force_n(
        wheel, road.forward_n, road.left_n, ax_mps2, ay_mps2, axle, p.body, p.suspension
    )
    load_n = suspension.tyre_load_n(state, wheel, axle, p.tyre)
    out.rate[AT.rise_m + wheel] = state[AT.rise_rate_mps + wheel]
    out.rate[AT.rise_rate_mps + wheel] = (load_n - axle.rest_load_n - corner_n) / axle.wheel_kg
    return corner_n


@compiled
def _wheel(
    state: Array,
    wheel: int,
    axle: Axle,
    angle_rad: float,
    drive_nm: float,
    p: Parameters,
    out: Derivative,
) -> WheelForce:
    """Force of the road on one wheel in body axes; its slips and spin go into `out`.

    Args:
        angle_rad: of the wheel against the body, positive to the left.
    """
    side = suspension.side_of(wheel)
    load_n = suspension.tyre_load_n(state, wheel, axle, p.tyre)
    road_friction = p.road.friction_left if side == LEFT else p.road.friction_right
    yaw_rate = state[AT.yaw_rate_radps]
    frame_forward_mps, frame_left_mps = body.running_gear_velocity(
        state[AT.vx_mps], state[AT.vy_mps], state[AT.roll_rate_radps], state[AT.pitch_rate_radps],
        p.body, p.suspension,
    )  # fmt: skip
    contact_forward_mps = frame_forward_mps - side * axle.half_track_m * yaw_rate
    contact_left_mps = frame_left_mps + axle.ahead_m * yaw_rate
    # The wheels follow the roll of the body only in part; travel compensates the rest.
    lean_per_m = side * 2.0 * (1.0 - axle.camber_gain) / axle.track_m
    lean_rad = state[AT.roll_rad] + lean_per_m * suspension.travel_m(state, wheel, axle)
    c = cos(angle_rad)
    s = sin(angle_rad)
    forward_mps = c * contact_forward_mps + s * contact_left_mps
    left_mps = c * contact_left_mps - s * contact_forward_mps

    spin = state[AT.spin_radps + wheel]
    lateral_slip = state[AT.lateral_slip + wheel]
    longitudinal_slip = state[AT.longitudinal_slip + wheel]
    radius_m = p.tyre.rolling_radius_m
    across = tyres.lateral_relaxation(lateral_slip, forward_mps, left_mps, load_n, p.tyre)
    along = tyres.longitudinal_relaxation(
        longitudinal_slip, forward_mps, spin * radius_m, load_n, p.tyre
    )
    road = tyres.force(
        lateral_slip + across.damping,
        longitudinal_slip + along.damping,
        lean_rad,
        load_n,
        road_friction,
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
        axle.brake_nm_per_mpa * max(0.0, state[AT.brake_mpa + wheel])
        + tyres.rolling_resistance_nm(spin, load_n, p.tyre)
    ) / p.tyre.spin_inertia_kgm2
    return WheelForce(
        c * road.forward_n - s * road.left_n,
        s * road.forward_n + c * road.left_n,
        road.aligning_nm,
        steering.kingpin_nm(road.aligning_nm, road.left_n, p.steering),
    )


@compiled
def bound(state: Array) -> None:
    """Limit slips and tilt angles in place.

    The slip of a standing wheel would grow without limit; a car that has rolled over stays on its
    side.
    """
    for i in range(AT.lateral_slip, AT.longitudinal_slip + N_WHEELS):
        state[i] = min(_LARGEST_SLIP, max(-_LARGEST_SLIP, state[i]))
    _stop_at(state, AT.roll_rad, AT.roll_rate_radps)
    _stop_at(state, AT.pitch_rad, AT.pitch_rate_radps)


@compiled
def _stop_at(state: Array, angle: int, rate: int) -> None:
    if abs(state[angle]) > _LARGEST_TILT_RAD:
        state[angle] = min(_LARGEST_TILT_RAD, max(-_LARGEST_TILT_RAD, state[angle]))
        state[rate] = 0.0
