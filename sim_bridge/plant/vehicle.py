"""The whole car as one function of state, inputs and parameters: x' = f(x, u, p).

`evaluate` writes its result to the three arrays of `Derivative`. Most states have a plain rate.
First-order lags are given as rate and decay, so that a step can solve them exactly. States with dry
friction have it separately, so that friction can stop a motion but not reverse it.
"""

from math import hypot, pi

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import ControlInput
from sim_bridge.plant import body, brakes, steering, suspension
from sim_bridge.plant.axles import Axle, axles
from sim_bridge.plant.drive import powertrain
from sim_bridge.plant.jit import compiled
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.states import AT, N_FRONT, N_WHEELS
from sim_bridge.plant.suspension import LEFT, RIGHT
from sim_bridge.plant.tyre import tyres
from sim_bridge.plant.wheels import Derivative, WheelForce, wheel_force

_LARGEST_TILT_RAD = 0.5 * pi


@compiled
def evaluate(state: Array, control: ControlInput, p: Parameters, out: Derivative) -> None:
    """Write the derivative of `state` under constant inputs to `out`."""
    yaw_rate = state[AT.yaw_rate_radps]
    front, rear = axles(p)
    front_roll_rad = suspension.axle_roll_rad(state, 0, front)
    rear_roll_rad = suspension.axle_roll_rad(state, N_FRONT, rear)
    _brake(control.brake_n, p, out)
    torque = powertrain.wheel_torque(state, control.throttle, p, out.rate, out.decay)

    front_left_rad, front_right_rad = front_wheels_rad(state, front_roll_rad, front, p)
    rear_rad = rear.roll_steer * rear_roll_rad + state[AT.rear_compliance_rad]
    fl = wheel_force(state, 0, front, front_left_rad, torque.front_wheel_nm, p, out)
    fr = wheel_force(state, 1, front, front_right_rad, torque.front_wheel_nm, p, out)
    rl = wheel_force(state, 2, rear, rear_rad, torque.rear_wheel_nm, p, out)
    rr = wheel_force(state, 3, rear, rear_rad, torque.rear_wheel_nm, p, out)
    out.rate[AT.torque_cut] = powertrain.cut_per_s(
        state, (fl.forward_mps, fr.forward_mps, rl.forward_mps, rr.forward_mps), p
    )

    left_n = fl.left_n + fr.left_n + rl.left_n + rr.left_n
    forward_n = fl.forward_n + fr.forward_n + rl.forward_n + rr.forward_n
    air = body.air_force(state[AT.vx_mps], state[AT.vy_mps], p.road, p.aero)
    # Forces per mass, as an accelerometer in the road plane reads them: without gravity.
    ax_mps2 = (forward_n + air.forward_n) / p.body.mass_kg
    ay_mps2 = (left_n + air.left_n) / p.body.mass_kg
    gravity = body.gravity_in_road_axes(p.road)
    yaw_nm = (
        p.body.front_axle_m * (fl.left_n + fr.left_n)
        - p.body.rear_axle_m * (rl.left_n + rr.left_n)
        + front.half_track_m * (fr.forward_n - fl.forward_n)
        + rear.half_track_m * (rr.forward_n - rl.forward_n)
        + fl.aligning_nm + fr.aligning_nm + rl.aligning_nm + rr.aligning_nm
        + air.yaw_nm
    )  # fmt: skip
    out.rate[AT.vx_mps] = ax_mps2 + gravity.forward_mps2 + yaw_rate * state[AT.vy_mps]
    out.rate[AT.vy_mps] = ay_mps2 + gravity.left_mps2 - yaw_rate * state[AT.vx_mps]
    out.rate[AT.yaw_rate_radps] = yaw_nm / p.body.yaw_inertia_kgm2

    front_drive_n = torque.front_wheel_nm / p.tyre.rolling_radius_m
    rear_drive_n = torque.rear_wheel_nm / p.tyre.rolling_radius_m
    corners_n = (
        _corner(state, 0, front, front_roll_rad, fl, front_drive_n, ax_mps2, ay_mps2, p, out),
        _corner(state, 1, front, front_roll_rad, fr, front_drive_n, ax_mps2, ay_mps2, p, out),
        _corner(state, 2, rear, rear_roll_rad, rl, rear_drive_n, ax_mps2, ay_mps2, p, out),
        _corner(state, 3, rear, rear_roll_rad, rr, rear_drive_n, ax_mps2, ay_mps2, p, out),
    )
    heave_mps2, roll_radps2, pitch_radps2 = body.sprung_acceleration(
        state[AT.roll_rad], state[AT.pitch_rad], forward_n, left_n, ax_mps2, ay_mps2,
        air.up_n + p.body.sprung_mass_kg * gravity.lighter_mps2,
        corners_n, p.body, p.suspension,
    )  # fmt: skip
    out.rate[AT.heave_m] = state[AT.heave_rate_mps]
    out.rate[AT.heave_rate_mps] = heave_mps2
    out.rate[AT.roll_rad] = state[AT.roll_rate_radps]
    out.rate[AT.roll_rate_radps] = roll_radps2
    out.rate[AT.pitch_rad] = state[AT.pitch_rate_radps]
    out.rate[AT.pitch_rate_radps] = pitch_radps2

    _compliance(fl, fr, rl, rr, front, rear, p, out)
    out.rate[AT.road_wheel_rad] = state[AT.road_wheel_rate_radps]
    out.rate[AT.contact_twist_rad] = state[AT.road_wheel_rate_radps]
    out.decay[AT.contact_twist_rad] = steering.twist_decay_per_s(
        state[AT.road_wheel_rate_radps], state[AT.vx_mps], p.tyre
    )
    parking_nm = _parking_nm(state, 0, p.road.friction_left, front, p)
    parking_nm += _parking_nm(state, 1, p.road.friction_right, front, p)
    out.rate[AT.road_wheel_rate_radps] = steering.steering_radps2(
        control.steer_rad,
        state[AT.road_wheel_rad],
        state[AT.road_wheel_rate_radps],
        fl.kingpin_nm + fr.kingpin_nm + parking_nm,
        p.steering,
    )
    out.friction[AT.road_wheel_rate_radps] = p.steering.friction_nm / p.steering.inertia_kgm2


@compiled
def front_wheels_rad(
    state: Array, axle_roll_rad: float, front: Axle, p: Parameters
) -> tuple[float, float]:
    """Angles of the front wheels against the body: steering, roll steer and compliance."""
    wheelbase_m = p.body.front_axle_m + p.body.rear_axle_m
    give_rad = front.roll_steer * axle_roll_rad + state[AT.front_compliance_rad]
    steered_rad = state[AT.road_wheel_rad]
    share, half_m = p.steering.ackermann, front.half_track_m
    return (
        steering.ackermann_rad(steered_rad, LEFT, half_m, wheelbase_m, share) + give_rad,
        steering.ackermann_rad(steered_rad, RIGHT, half_m, wheelbase_m, share) + give_rad,
    )


@compiled
def _parking_nm(
    state: Array, wheel: int, road_friction: float, front: Axle, p: Parameters
) -> float:
    load_n = suspension.tyre_load_n(state, wheel, front, p.tyre)
    return steering.parking_nm(state[AT.contact_twist_rad], load_n, road_friction, p.tyre)


@compiled
def _compliance(
    fl: WheelForce,
    fr: WheelForce,
    rl: WheelForce,
    rr: WheelForce,
    front: Axle,
    rear: Axle,
    p: Parameters,
    out: Derivative,
) -> None:
    """Wheel angles that the bushings give under side force and aligning moment, with a lag.

    The lag stands for the mass of the wheels on their bushings, and keeps the force of a step from
    depending on an angle that depends on the force.
    """
    front_rad = front.lateral_steer_radpn * (fl.side_n + fr.side_n)
    front_rad += front.aligning_steer_radpnm * (fl.aligning_nm + fr.aligning_nm)
    rear_rad = rear.lateral_steer_radpn * (rl.side_n + rr.side_n)
    rear_rad += rear.aligning_steer_radpnm * (rl.aligning_nm + rr.aligning_nm)
    lag_s = p.suspension.compliance_lag_s
    out.rate[AT.front_compliance_rad] = front_rad / lag_s
    out.decay[AT.front_compliance_rad] = 1.0 / lag_s
    out.rate[AT.rear_compliance_rad] = rear_rad / lag_s
    out.decay[AT.rear_compliance_rad] = 1.0 / lag_s


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
    drive_n: float,
    ax_mps2: float,
    ay_mps2: float,
    p: Parameters,
    out: Derivative,
) -> float:
    """Upward force of one corner on the body; the vertical motion of its wheel goes into `out`."""
    spring_n = suspension.spring_force_n(state, wheel, axle_roll_rad, axle)
    corner_n = spring_n + suspension.arm_force_n(
        wheel, road.forward_n, road.left_n, drive_n, ax_mps2, ay_mps2, axle, p.body
    )
    load_n = suspension.tyre_load_n(state, wheel, axle, p.tyre)
    out.rate[AT.rise_m + wheel] = state[AT.rise_rate_mps + wheel]
    out.rate[AT.rise_rate_mps + wheel] = (
        load_n - axle.rest_load_n - corner_n
    ) / axle.wheel_kg + body.gravity_in_road_axes(p.road).lighter_mps2
    return corner_n


@compiled
def bound(state: Array, p: Parameters) -> None:
    """Limit slips, valves and tilt angles in place.

    The slip of a standing wheel would grow without limit; a car that has rolled over stays on its
    side.
    """
    car_mps = hypot(state[AT.vx_mps], state[AT.vy_mps])
    car_mps += abs(state[AT.yaw_rate_radps]) * p.body.rear_axle_m
    for wheel in range(N_WHEELS):
        rim_mps = abs(state[AT.spin_radps + wheel]) * p.tyre.rolling_radius_m
        is_left = suspension.side_of(wheel) == LEFT
        road_friction = p.road.friction_left if is_left else p.road.friction_right
        largest = tyres.largest_slip(max(car_mps, rim_mps), road_friction, p.tyre)
        for first in (AT.lateral_slip, AT.longitudinal_slip):
            state[first + wheel] = min(largest, max(-largest, state[first + wheel]))
        release = state[AT.brake_release + wheel]
        state[AT.brake_release + wheel] = min(1.0, max(0.0, release))
    state[AT.torque_cut] = min(1.0, max(0.0, state[AT.torque_cut]))
    _stop_at(state, AT.roll_rad, AT.roll_rate_radps)
    _stop_at(state, AT.pitch_rad, AT.pitch_rate_radps)


@compiled
def _stop_at(state: Array, angle: int, rate: int) -> None:
    if abs(state[angle]) > _LARGEST_TILT_RAD:
        state[angle] = min(_LARGEST_TILT_RAD, max(-_LARGEST_TILT_RAD, state[angle]))
        state[rate] = 0.0
