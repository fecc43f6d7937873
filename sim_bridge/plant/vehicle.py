"""The whole car as one function of state, inputs and parameters: x' = f(x, u, p).

`evaluate` leaves the answer in the three arrays of `Derivative`: most states have a plain rate,
lags are kept as rate and decay so that a step can solve them exactly, and wheels carry dry
friction that may stop them but never turn them round.
"""

from math import cos, sin
from typing import NamedTuple

from numpy import float64
from numpy.typing import NDArray

from sim_bridge.plant import aero, body, brakes, converter, driveline, engine, gearbox, tyres
from sim_bridge.plant.jit import compiled
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.states import AT
from sim_bridge.plant.steering import steady_road_wheel_rad
from sim_bridge.plant.suspension import WheelValues, corner_forces, wheel_loads

_LARGEST_SLIP = 3.0


class Derivative(NamedTuple):
    """How a state moves: x' = rate - decay x, and dry friction of size `friction` against x.

    Three arrays of `N_STATES` entries each.
    """

    rate: NDArray[float64]
    decay: NDArray[float64]
    friction: NDArray[float64]


class WheelForce(NamedTuple):
    """Force of the road on one wheel in body axes, and its moment around the vertical."""

    forward_n: float
    left_n: float
    aligning_nm: float


class RoadForces(NamedTuple):
    """What the road does to the body, body axes; lateral forces by axle."""

    forward_n: float
    front_left_n: float
    rear_left_n: float
    yaw_nm: float


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
    vx_mps = state[AT.vx_mps]
    vy_mps = state[AT.vy_mps]
    yaw_rate = state[AT.yaw_rate_radps]
    roll_rad = state[AT.roll_rad]
    pitch_rad = state[AT.pitch_rad]

    corners = corner_forces(
        state[AT.heave_m],
        state[AT.heave_rate_mps],
        roll_rad,
        state[AT.roll_rate_radps],
        pitch_rad,
        state[AT.pitch_rate_radps],
        p.body,
        p.suspension,
    )
    loads = wheel_loads(
        corners, state[AT.settled_ax_mps2], state[AT.settled_ay_mps2], p.body, p.suspension
    )

    front_spin = 0.5 * (state[AT.spin_radps] + state[AT.spin_radps + 1])
    rear_spin = 0.5 * (state[AT.spin_radps + 2] + state[AT.spin_radps + 3])
    drive = _drive(state, front_spin, rear_spin, throttle, p, out)
    braking = brakes.brake_torque(state[AT.brake_mpa], p.brakes)
    out.rate[AT.brake_mpa] = p.brakes.pedal_mpa_per_n * brake_n / p.brakes.lag_s
    out.decay[AT.brake_mpa] = 1.0 / p.brakes.lag_s

    road = _road_forces(state, loads, drive, braking, p, out)
    air = aero.air_force(vx_mps, p.aero)
    ax_mps2 = (road.forward_n + air.forward_n) / p.body.mass_kg
    ay_mps2 = (road.front_left_n + road.rear_left_n) / p.body.mass_kg
    sprung = body.sprung_acceleration(
        roll_rad, pitch_rad, ax_mps2, ay_mps2, air.up_n, corners, p.body, p.suspension
    )

    out.rate[AT.vx_mps] = ax_mps2 + yaw_rate * vy_mps
    out.rate[AT.vy_mps] = ay_mps2 - yaw_rate * vx_mps
    out.rate[AT.yaw_rate_radps] = road.yaw_nm / p.body.yaw_inertia_kgm2
    out.rate[AT.heave_m] = state[AT.heave_rate_mps]
    out.rate[AT.heave_rate_mps] = sprung.heave_mps2
    out.rate[AT.roll_rad] = state[AT.roll_rate_radps]
    out.rate[AT.roll_rate_radps] = sprung.roll_radps2
    out.rate[AT.pitch_rad] = state[AT.pitch_rate_radps]
    out.rate[AT.pitch_rate_radps] = sprung.pitch_radps2
    out.rate[AT.settled_ax_mps2] = ax_mps2 / p.suspension.load_lag_s
    out.decay[AT.settled_ax_mps2] = 1.0 / p.suspension.load_lag_s
    out.rate[AT.settled_ay_mps2] = ay_mps2 / p.suspension.load_lag_s
    out.decay[AT.settled_ay_mps2] = 1.0 / p.suspension.load_lag_s
    out.rate[AT.road_wheel_rad] = (
        steady_road_wheel_rad(steer_rad, road.front_left_n, p.steering) / p.steering.lag_s
    )
    out.decay[AT.road_wheel_rad] = 1.0 / p.steering.lag_s
    return loads


@compiled
def _road_forces(
    state: NDArray[float64],
    loads: WheelValues,
    drive: driveline.AxleTorque,
    braking: brakes.BrakeTorque,
    p: Parameters,
    out: Derivative,
) -> RoadForces:
    """What the four wheels do to the body; their slips and spins go into `out`."""
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
    front_m = p.body.front_axle_m
    rear_m = p.body.rear_axle_m
    half_m = 0.5 * p.body.track_m
    front_rad = state[AT.road_wheel_rad] + p.suspension.roll_steer_front * roll_rad
    rear_rad = p.suspension.roll_steer_rear * roll_rad
    front_lean = p.suspension.camber_gain_front * roll_rad
    rear_lean = p.suspension.camber_gain_rear * roll_rad
    front_left_mps = frame.left_mps + front_m * yaw_rate
    rear_left_mps = frame.left_mps - rear_m * yaw_rate
    left_side_mps = frame.forward_mps - half_m * yaw_rate
    right_side_mps = frame.forward_mps + half_m * yaw_rate

    fl = _wheel(
        state, 0, left_side_mps, front_left_mps, front_rad, front_lean, loads.front_left,
        drive.front_wheel_nm, braking.front_wheel_nm, p, out,
    )  # fmt: skip
    fr = _wheel(
        state, 1, right_side_mps, front_left_mps, front_rad, front_lean, loads.front_right,
        drive.front_wheel_nm, braking.front_wheel_nm, p, out,
    )  # fmt: skip
    rl = _wheel(
        state, 2, left_side_mps, rear_left_mps, rear_rad, rear_lean, loads.rear_left,
        drive.rear_wheel_nm, braking.rear_wheel_nm, p, out,
    )  # fmt: skip
    rr = _wheel(
        state, 3, right_side_mps, rear_left_mps, rear_rad, rear_lean, loads.rear_right,
        drive.rear_wheel_nm, braking.rear_wheel_nm, p, out,
    )  # fmt: skip
    front_n = fl.left_n + fr.left_n
    rear_n = rl.left_n + rr.left_n
    return RoadForces(
        fl.forward_n + fr.forward_n + rl.forward_n + rr.forward_n,
        front_n,
        rear_n,
        front_m * front_n
        - rear_m * rear_n
        + half_m * (fr.forward_n + rr.forward_n - fl.forward_n - rl.forward_n)
        + fl.aligning_nm
        + fr.aligning_nm
        + rl.aligning_nm
        + rr.aligning_nm,
    )


@compiled
def _drive(
    state: NDArray[float64],
    front_spin_radps: float,
    rear_spin_radps: float,
    throttle: float,
    p: Parameters,
    out: Derivative,
) -> driveline.AxleTorque:
    """Engine, converter, gearbox and differentials: torques at the wheels, engine's motion."""
    ratio = gearbox.ratio(state[AT.gear], state[AT.gear_before], state[AT.since_shift_s], p.gearbox)
    output_radps = driveline.output_speed_radps(front_spin_radps, rear_spin_radps, p.driveline)
    hydraulic = converter.converter_torque(
        state[AT.engine_radps], ratio * output_radps, p.converter
    )
    efficiency = gearbox.efficiency(state[AT.gear], p.gearbox)
    if hydraulic.turbine_nm < 0.0:
        efficiency = 1.0 / efficiency
    engine_nm = engine.torque_nm(state[AT.engine_radps], state[AT.throttle], p.engine)
    out.rate[AT.engine_radps] = (engine_nm - hydraulic.impeller_nm) / p.engine.inertia_kgm2
    out.rate[AT.throttle] = throttle / p.engine.throttle_lag_s
    out.decay[AT.throttle] = 1.0 / p.engine.throttle_lag_s
    carried = gearbox.handed_over(state[AT.since_shift_s], p.gearbox)
    return driveline.axle_torque(
        hydraulic.turbine_nm * ratio * efficiency * carried,
        front_spin_radps,
        rear_spin_radps,
        p.driveline,
    )


@compiled
def _wheel(
    state: NDArray[float64],
    wheel: int,
    body_forward_mps: float,
    body_left_mps: float,
    angle_rad: float,
    lean_rad: float,
    load_n: float,
    drive_nm: float,
    brake_nm: float,
    p: Parameters,
    out: Derivative,
) -> WheelForce:
    """One wheel: slips and spin into `out`, its force back in body axes."""
    spin = state[AT.spin_radps + wheel]
    lateral_slip = state[AT.lateral_slip + wheel]
    longitudinal_slip = state[AT.longitudinal_slip + wheel]
    c = cos(angle_rad)
    s = sin(angle_rad)
    forward_mps = c * body_forward_mps + s * body_left_mps
    left_mps = c * body_left_mps - s * body_forward_mps
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
        p.road.friction,
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
        brake_nm + tyres.rolling_resistance_nm(spin, load_n, p.tyre)
    ) / p.tyre.spin_inertia_kgm2
    return WheelForce(
        c * road.forward_n - s * road.left_n,
        s * road.forward_n + c * road.left_n,
        road.aligning_nm,
    )


@compiled
def bound(state: NDArray[float64]) -> None:
    """Keep slips where they still mean something: a standing wheel would wind them up forever."""
    for i in range(AT.lateral_slip, AT.longitudinal_slip + 4):
        state[i] = min(_LARGEST_SLIP, max(-_LARGEST_SLIP, state[i]))


@compiled
def output_speed_radps(state: NDArray[float64], p: Parameters) -> float:
    """Speed of the gearbox's output shaft."""
    return driveline.output_speed_radps(
        0.5 * (state[AT.spin_radps] + state[AT.spin_radps + 1]),
        0.5 * (state[AT.spin_radps + 2] + state[AT.spin_radps + 3]),
        p.driveline,
    )
