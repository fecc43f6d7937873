"""Equations of a single-track car with lags, as machine code, on the road it drives along.

Forces are per unit of mass: no motion tells a heavy car with strong tyres from a light one with
weak ones. All kernels are in this one file, which is all that the compiler's cache looks at.

Pacejka, *Tyre and Vehicle Dynamics* (2012), chapters 1 (single-track model), 4 (Magic Formula)
and 7 (relaxation).
"""

from typing import NamedTuple

import numpy as np
from numpy import float64
from numpy.typing import NDArray

from sim_bridge.plant.jit import compiled

Array = NDArray[float64]

GRAVITY_MPS2 = 9.81
SUBSTEPS = 2
"""of a period: relaxation at high speed is too fast for one Runge-Kutta step of 25 ms"""

LEAST_SPEED_MPS = 1.0
"""slip angles are of a rolling car"""

LEAST_GRIP_LEFT = 0.2
"""of the side force, however hard the wheel is driven or braked"""


class Bicycle(NamedTuple):
    """Every number of the car but its map of drive; "per mass" forces are in m/s^2."""

    front_axle_m: float
    rear_axle_m: float
    gyration_m2: float
    """yaw inertia per mass"""
    height_m: float
    """of the centre of gravity: what moves load between the axles"""
    steering_ratio: float
    steering_lag_s: float
    steering_give_rad_per_mps2: float
    """how far the front wheels give way to their side force"""
    stiffness_front_per_rad: float
    """cornering stiffness in units of the axle's load"""
    stiffness_rear_per_rad: float
    friction_front: float
    friction_rear: float
    shape_front: float
    """C of the Magic Formula"""
    shape_rear: float
    curvature_front: float
    """E of the Magic Formula"""
    curvature_rear: float
    relaxation_front_m: float
    relaxation_rear_m: float
    lift_front_per_m: float
    """load that the air takes off the axle, per mass and squared speed"""
    lift_rear_per_m: float
    roll_radps: float
    """natural frequency of the lagged side acceleration that stands for roll"""
    roll_damping: float
    """its share of critical damping"""
    roll_steer_front_rad_per_mps2: float
    roll_steer_rear_rad_per_mps2: float
    sway_m_per_mps2: float
    """how far the axles move sideways under roll"""
    throttle_lag_s: float
    drive_lag_s: float
    drive_share_front: float
    brake_mps2_per_n: float
    brake_knee_n: float
    """pedal force above which the rear brakes follow less"""
    brake_above_knee: float
    """share of the gain that is left above the knee"""
    brake_lag_s: float
    brake_share_front: float
    rolling_mps2: float
    drag_per_m: float
    surge_gain: float
    """share of the unexplained longitudinal acceleration that one period adds to its estimate"""
    surge_memory_s: float
    sway_gain: float
    sway_memory_s: float
    swing_gain: float
    """the same of the yaw acceleration"""
    swing_memory_s: float


STATES = 14
"""v_x, v_y, yaw rate; e_y, e_psi, s; road-wheel angle, throttle, drive, brake, roll and its rate,
lagged slip front and rear"""


@compiled
def roll_out(
    past: Array,
    x0: Array,
    U: Array,
    kappa: Array,
    car: Bicycle,
    speeds_mps: Array,
    throttles: Array,
    drive_mps2: Array,
    dt_s: float,
) -> Array:
    """States (batch, K+1, 6) from x0 (batch, 6) under U (batch, K, 3) and kappa (batch, K).

    Lags and unexplained accelerations are brought to their first values along past (batch, H, 6),
    where the motion is as it was measured.
    """
    batch, periods = U.shape[0], U.shape[1]
    rows = past.shape[1]
    states = np.empty((batch, periods + 1, 6))
    s, work = np.empty(STATES), np.empty((5, STATES))
    gain = np.array([car.surge_gain, car.sway_gain, car.swing_gain])
    memory = np.exp(-dt_s / np.array([car.surge_memory_s, car.sway_memory_s, car.swing_memory_s]))
    for b in range(batch):
        states[b, 0] = x0[b]
        unexplained = np.zeros(3)
        s[:] = 0.0
        if rows > 0:
            s[:3] = past[b, 0, :3]
            _settle(s, past[b, 0, 3:], car, speeds_mps, throttles, drive_mps2)
        else:
            s[:3] = x0[b, :3]
            _settle(s, U[b, 0], car, speeds_mps, throttles, drive_mps2)
        for k in range(rows):
            _period(
                s,
                past[b, k, 3:],
                0.0,
                unexplained,
                car,
                speeds_mps,
                throttles,
                drive_mps2,
                dt_s,
                work,
            )
            measured = past[b, k + 1, :3] if k + 1 < rows else x0[b, :3]
            for i in range(3):
                unexplained[i] = memory[i] * unexplained[i] + gain[i] * (measured[i] - s[i]) / dt_s
                s[i] = measured[i]
        s[3], s[4], s[5] = x0[b, 4], x0[b, 5], 0.0
        for k in range(periods):
            before_m = s[5]
            _period(
                s,
                U[b, k],
                kappa[b, k],
                unexplained,
                car,
                speeds_mps,
                throttles,
                drive_mps2,
                dt_s,
                work,
            )
            unexplained *= memory
            states[b, k + 1, :3] = s[:3]
            states[b, k + 1, 3] = s[5] - before_m
            states[b, k + 1, 4:] = s[3:5]
    return states


@compiled
def _settle(
    s: Array,
    u: Array,
    car: Bicycle,
    speeds_mps: Array,
    throttles: Array,
    drive_mps2: Array,
) -> None:
    """Give the lags the values that they would have, had motion and inputs long been the same."""
    vx = max(s[0], LEAST_SPEED_MPS)
    side_mps2 = s[2] * vx
    s[6] = u[2] / car.steering_ratio
    s[7] = u[0]
    s[8] = _look_up(u[0], vx, speeds_mps, throttles, drive_mps2)
    s[9] = u[1]
    s[10] = side_mps2
    s[11] = 0.0
    s[12] = (
        s[6] + car.roll_steer_front_rad_per_mps2 * side_mps2 - (s[1] + car.front_axle_m * s[2]) / vx
    )
    s[13] = car.roll_steer_rear_rad_per_mps2 * side_mps2 - (s[1] - car.rear_axle_m * s[2]) / vx


@compiled
def _period(
    s: Array,
    u: Array,
    kappa: float,
    unexplained: Array,
    car: Bicycle,
    speeds_mps: Array,
    throttles: Array,
    drive_mps2: Array,
    dt_s: float,
    work: Array,
) -> None:
    """Move s on by one period, in Runge-Kutta steps of fourth order."""
    h = dt_s / SUBSTEPS
    for _ in range(SUBSTEPS):
        work[4] = s
        for stage in range(4):
            _rate(
                work[4], u, kappa, unexplained, car, speeds_mps, throttles, drive_mps2, work[stage]
            )
            ahead = h if stage == 2 else 0.5 * h
            for i in range(STATES):
                work[4, i] = s[i] + ahead * work[stage, i]
        for i in range(STATES):
            s[i] += h / 6.0 * (work[0, i] + 2.0 * (work[1, i] + work[2, i]) + work[3, i])


@compiled
def _rate(
    s: Array,
    u: Array,
    kappa: float,
    unexplained: Array,
    car: Bicycle,
    speeds_mps: Array,
    throttles: Array,
    drive_mps2: Array,
    rate: Array,
) -> None:
    """How fast each of s changes, into `rate`."""
    vx, vy, yaw_rate, ey, epsi = max(s[0], LEAST_SPEED_MPS), s[1], s[2], s[3], s[4]
    drive, pedal_n, roll, roll_rate = s[8], s[9], s[10], s[11]
    wheelbase_m = car.front_axle_m + car.rear_axle_m

    brake = car.brake_mps2_per_n * (
        pedal_n - (1.0 - car.brake_above_knee) * max(pedal_n - car.brake_knee_n, 0.0)
    )
    along = drive - brake - car.rolling_mps2 - car.drag_per_m * vx * vx
    load_front = (GRAVITY_MPS2 * car.rear_axle_m - car.height_m * along) / wheelbase_m
    load_rear = (GRAVITY_MPS2 * car.front_axle_m + car.height_m * along) / wheelbase_m
    load_front = max(load_front - car.lift_front_per_m * vx * vx, 0.1)
    load_rear = max(load_rear - car.lift_rear_per_m * vx * vx, 0.1)
    along_front = drive * car.drive_share_front - brake * car.brake_share_front
    along_rear = drive * (1.0 - car.drive_share_front) - brake * (1.0 - car.brake_share_front)
    side_front = load_front * _side_force(
        s[12],
        along_front / load_front,
        car.stiffness_front_per_rad,
        car.friction_front,
        car.shape_front,
        car.curvature_front,
    )
    side_rear = load_rear * _side_force(
        s[13],
        along_rear / load_rear,
        car.stiffness_rear_per_rad,
        car.friction_rear,
        car.shape_rear,
        car.curvature_rear,
    )
    front_rad = (
        s[6]
        + car.roll_steer_front_rad_per_mps2 * roll
        - car.steering_give_rad_per_mps2 * side_front
    )
    rear_rad = car.roll_steer_rear_rad_per_mps2 * roll
    sway_mps = car.sway_m_per_mps2 * roll_rate
    sine, cosine = np.sin(front_rad), np.cos(front_rad)
    across_front = side_front * cosine + along_front * sine
    across = across_front + side_rear

    rate[0] = along - side_front * sine - along_front * (1.0 - cosine) + yaw_rate * vy
    rate[0] += unexplained[0]
    rate[1] = across - yaw_rate * vx + unexplained[1]
    rate[2] = (
        car.front_axle_m * across_front - car.rear_axle_m * side_rear
    ) / car.gyration_m2 + unexplained[2]
    progress_mps = (vx * np.cos(epsi) - vy * np.sin(epsi)) / (1.0 - kappa * ey)
    rate[3] = vx * np.sin(epsi) + vy * np.cos(epsi)
    rate[4] = yaw_rate - kappa * progress_mps
    rate[5] = progress_mps
    rate[6] = (u[2] / car.steering_ratio - s[6]) / car.steering_lag_s
    rate[7] = (u[0] - s[7]) / car.throttle_lag_s
    rate[8] = (_look_up(s[7], vx, speeds_mps, throttles, drive_mps2) - drive) / car.drive_lag_s
    rate[9] = (u[1] - pedal_n) / car.brake_lag_s
    rate[10] = roll_rate
    rate[11] = car.roll_radps**2 * (across - roll) - 2.0 * car.roll_damping * car.roll_radps * (
        roll_rate
    )
    slip_front = front_rad - np.arctan((vy + car.front_axle_m * yaw_rate + sway_mps) / vx)
    slip_rear = rear_rad - np.arctan((vy - car.rear_axle_m * yaw_rate + sway_mps) / vx)
    rate[12] = (slip_front - s[12]) * vx / car.relaxation_front_m
    rate[13] = (slip_rear - s[13]) * vx / car.relaxation_rear_m


@compiled
def _side_force(
    slip_rad: float, along: float, stiffness: float, friction: float, shape: float, curvature: float
) -> float:
    """Side force per load: Magic Formula, less what is used along (friction ellipse)."""
    z = stiffness / (shape * friction) * slip_rad
    pure = friction * np.sin(shape * np.arctan(z - curvature * (z - np.arctan(z))))
    left = 1.0 - (along / friction) ** 2
    return float(pure * np.sqrt(max(left, LEAST_GRIP_LEFT**2)))


@compiled
def _look_up(
    throttle: float, vx: float, speeds_mps: Array, throttles: Array, drive_mps2: Array
) -> float:
    """Drive per mass from the map (throttles, speeds), linear between its nodes, ends held."""
    i, a = _between(throttle, throttles)
    j, b = _between(vx, speeds_mps)
    low = (1.0 - b) * drive_mps2[i, j] + b * drive_mps2[i, j + 1]
    high = (1.0 - b) * drive_mps2[i + 1, j] + b * drive_mps2[i + 1, j + 1]
    return float((1.0 - a) * low + a * high)


@compiled
def _between(value: float, nodes: Array) -> tuple[int, float]:
    """The node below and the share of the way to the next one."""
    i = 0
    while i < len(nodes) - 2 and value > nodes[i + 1]:
        i += 1
    share = (value - nodes[i]) / (nodes[i + 1] - nodes[i])
    return i, min(max(share, 0.0), 1.0)
