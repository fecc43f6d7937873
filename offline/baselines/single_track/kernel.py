"""Equations of a single-track car with lags on its road, compiled.

Forces are per unit of mass, because the mass cannot be identified from motion. All kernels are in
this one file: the compiler's cache looks at one file only.

Pacejka, *Tyre and Vehicle Dynamics* (2012), chapters 1 (single-track model), 4 (Magic Formula)
and 7 (relaxation).
"""

from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import MOTION, InputColumn, StateColumn
from sim_bridge.plant.jit import compiled

_GRAVITY_MPS2 = 9.81
"""rounded, as in the published fit; the fitted stiffness per load compensates the difference"""
_THROTTLE, _BRAKE, _STEER = (int(column) for column in InputColumn)
_DS, _EY, _EPSI = int(StateColumn.ds_m), int(StateColumn.ey_m), int(StateColumn.epsi_rad)
_MOTION_END: int = MOTION.stop
"""the first columns of states and of a history are the motion, as the first entries of `s`"""
SUBSTEPS = 2
"""of a period: tyre relaxation at high speed needs Runge-Kutta steps below 25 ms"""

LEAST_SPEED_MPS = 1.0
"""in slip angles, which are not defined at standstill"""

LEAST_GRIP_LEFT = 0.2
"""share of the side force that remains under full drive or braking"""


class Bicycle(NamedTuple):
    """All parameters but the drive map; forces per mass are in m/s^2.

    The defaults are of a typical mid-size car; a fit starts from them.
    """

    front_axle_m: float = 1.1
    rear_axle_m: float = 1.5
    gyration_m2: float = 1.8
    """yaw inertia per mass"""
    height_m: float = 0.5
    """of the centre of gravity"""
    steering_ratio: float = 18.0
    steering_lag_s: float = 0.04
    steering_give_rad_per_mps2: float = 0.0
    """steering compliance: angle of the front wheels per side force"""
    stiffness_front_per_rad: float = 12.0
    """cornering stiffness in units of the axle's load"""
    stiffness_rear_per_rad: float = 14.0
    friction_front: float = 1.0
    friction_rear: float = 1.0
    shape_front: float = 1.4
    """C of the Magic Formula"""
    shape_rear: float = 1.4
    curvature_front: float = 0.0
    """E of the Magic Formula"""
    curvature_rear: float = 0.0
    relaxation_front_m: float = 0.5
    relaxation_rear_m: float = 0.5
    lift_front_per_m: float = 0.0
    """aerodynamic lift of the axle, per mass and squared speed"""
    lift_rear_per_m: float = 0.0
    roll_radps: float = 10.0
    """natural frequency of roll, modelled as a lagged lateral acceleration"""
    roll_damping: float = 0.4
    """damping ratio of roll"""
    roll_steer_front_rad_per_mps2: float = 0.0
    roll_steer_rear_rad_per_mps2: float = 0.0
    sway_m_per_mps2: float = 0.0
    """lateral motion of the axles under roll"""
    throttle_lag_s: float = 0.15
    drive_lag_s: float = 0.1
    drive_share_front: float = 0.5
    brake_mps2_per_n: float = 0.06
    brake_knee_n: float = 60.0
    """pedal force above which the gain is smaller"""
    brake_above_knee: float = 0.8
    """share of the gain above the knee"""
    brake_lag_s: float = 0.06
    brake_share_front: float = 0.65
    rolling_mps2: float = 0.1
    drag_per_m: float = 3e-4
    surge_gain: float = 0.2
    """observer gain of the unexplained longitudinal acceleration"""
    surge_memory_s: float = 0.5
    sway_gain: float = 0.1
    sway_memory_s: float = 0.3
    swing_gain: float = 0.1
    """observer gain of the unexplained yaw acceleration"""
    swing_memory_s: float = 0.3


class DriveMap(NamedTuple):
    """Drive force per mass over throttle and speed."""

    speeds_mps: Array
    """(V,) ascending"""
    throttles: Array
    """(T,) ascending"""
    drive_mps2: Array
    """(T, V)"""


STATES = 14
"""v_x, v_y, yaw rate; e_y, e_psi, s; road-wheel angle, throttle, drive, brake, roll and its rate,
lagged slip front and rear"""


@compiled
def simulate(
    past: Array, x0: Array, U: Array, kappa: Array, car: Bicycle, drive_map: DriveMap, dt_s: float
) -> Array:
    """States (batch, K+1, 6) from x0 (batch, 6) under U (batch, K, 3) and kappa (batch, K).

    Lags and unexplained accelerations are estimated along past (batch, H, 6), where the motion is
    as measured.
    """
    batch, periods = U.shape[0], U.shape[1]
    rows = past.shape[1]
    states = np.empty((batch, periods + 1, x0.shape[1]))
    s, work = np.empty(STATES), np.empty((5, STATES))
    gain = np.array([car.surge_gain, car.sway_gain, car.swing_gain])
    memory = np.exp(-dt_s / np.array([car.surge_memory_s, car.sway_memory_s, car.swing_memory_s]))
    for b in range(batch):
        states[b, 0] = x0[b]
        unexplained = np.zeros(3)
        s[:] = 0.0
        if rows > 0:
            s[:_MOTION_END] = past[b, 0, :_MOTION_END]
            _settle(s, past[b, 0, _MOTION_END:], car, drive_map)
        else:
            s[:_MOTION_END] = x0[b, :_MOTION_END]
            _settle(s, U[b, 0], car, drive_map)
        for k in range(rows):
            _period(s, past[b, k, _MOTION_END:], 0.0, unexplained, car, drive_map, dt_s, work)
            measured = past[b, k + 1, :_MOTION_END] if k + 1 < rows else x0[b, :_MOTION_END]
            for i in range(3):
                unexplained[i] = memory[i] * unexplained[i] + gain[i] * (measured[i] - s[i]) / dt_s
                s[i] = measured[i]
        s[3], s[4], s[5] = x0[b, _EY], x0[b, _EPSI], 0.0
        for k in range(periods):
            before_m = s[5]
            _period(s, U[b, k], kappa[b, k], unexplained, car, drive_map, dt_s, work)
            unexplained *= memory
            states[b, k + 1, :_MOTION_END] = s[:_MOTION_END]
            states[b, k + 1, _DS] = s[5] - before_m
            states[b, k + 1, _EY], states[b, k + 1, _EPSI] = s[3], s[4]
    return states


@compiled
def _settle(s: Array, u: Array, car: Bicycle, drive_map: DriveMap) -> None:
    """Set the lags to their steady state for the present motion and inputs."""
    vx = max(s[0], LEAST_SPEED_MPS)
    side_mps2 = s[2] * vx
    s[6] = u[_STEER] / car.steering_ratio
    s[7] = u[_THROTTLE]
    s[8] = _look_up(u[_THROTTLE], vx, drive_map)
    s[9] = u[_BRAKE]
    s[10] = side_mps2
    s[11] = 0.0
    s[12] = (
        s[6] + car.roll_steer_front_rad_per_mps2 * side_mps2 - (s[1] + car.front_axle_m * s[2]) / vx
    )
    s[13] = car.roll_steer_rear_rad_per_mps2 * side_mps2 - (s[1] - car.rear_axle_m * s[2]) / vx


@compiled
def _period(
    s: Array, u: Array, kappa: float, unexplained: Array, car: Bicycle, drive_map: DriveMap,
    dt_s: float, work: Array,
) -> None:  # fmt: skip
    """Integrate s over one period by fourth-order Runge-Kutta steps."""
    h = dt_s / SUBSTEPS
    for _ in range(SUBSTEPS):
        work[4] = s
        for stage in range(4):
            _rate(work[4], u, kappa, unexplained, car, drive_map, work[stage])
            ahead = h if stage == 2 else 0.5 * h
            for i in range(STATES):
                work[4, i] = s[i] + ahead * work[stage, i]
        for i in range(STATES):
            s[i] += h / 6.0 * (work[0, i] + 2.0 * (work[1, i] + work[2, i]) + work[3, i])


@compiled
def _rate(
    s: Array, u: Array, kappa: float, unexplained: Array, car: Bicycle, drive_map: DriveMap,
    rate: Array,
) -> None:  # fmt: skip
    """Write ds/dt to `rate`."""
    vx, vy, yaw_rate, ey, epsi = max(s[0], LEAST_SPEED_MPS), s[1], s[2], s[3], s[4]
    drive, pedal_n, roll, roll_rate = s[8], s[9], s[10], s[11]
    wheelbase_m = car.front_axle_m + car.rear_axle_m

    brake = car.brake_mps2_per_n * (
        pedal_n - (1.0 - car.brake_above_knee) * max(pedal_n - car.brake_knee_n, 0.0)
    )
    along = drive - brake - car.rolling_mps2 - car.drag_per_m * vx * vx
    load_front = (_GRAVITY_MPS2 * car.rear_axle_m - car.height_m * along) / wheelbase_m
    load_rear = (_GRAVITY_MPS2 * car.front_axle_m + car.height_m * along) / wheelbase_m
    load_front = max(load_front - car.lift_front_per_m * vx * vx, 0.1)
    load_rear = max(load_rear - car.lift_rear_per_m * vx * vx, 0.1)
    along_front = drive * car.drive_share_front - brake * car.brake_share_front
    along_rear = drive * (1.0 - car.drive_share_front) - brake * (1.0 - car.brake_share_front)
    front = (car.stiffness_front_per_rad, car.friction_front, car.shape_front, car.curvature_front)
    side_front = load_front * _side_force(s[12], along_front / load_front, front)
    rear = (car.stiffness_rear_per_rad, car.friction_rear, car.shape_rear, car.curvature_rear)
    side_rear = load_rear * _side_force(s[13], along_rear / load_rear, rear)
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
    rate[6] = (u[_STEER] / car.steering_ratio - s[6]) / car.steering_lag_s
    rate[7] = (u[_THROTTLE] - s[7]) / car.throttle_lag_s
    rate[8] = (_look_up(s[7], vx, drive_map) - drive) / car.drive_lag_s
    rate[9] = (u[_BRAKE] - pedal_n) / car.brake_lag_s
    rate[10] = roll_rate
    rate[11] = car.roll_radps**2 * (across - roll) - 2.0 * car.roll_damping * car.roll_radps * (
        roll_rate
    )
    slip_front = front_rad - np.arctan((vy + car.front_axle_m * yaw_rate + sway_mps) / vx)
    slip_rear = rear_rad - np.arctan((vy - car.rear_axle_m * yaw_rate + sway_mps) / vx)
    rate[12] = (slip_front - s[12]) * vx / car.relaxation_front_m
    rate[13] = (slip_rear - s[13]) * vx / car.relaxation_rear_m


@compiled
def _side_force(slip_rad: float, along: float, tyre: tuple[float, float, float, float]) -> float:
    """Side force per load: Magic Formula, reduced by the longitudinal force (friction ellipse)."""
    stiffness, friction, shape, curvature = tyre
    z = stiffness / (shape * friction) * slip_rad
    pure = friction * np.sin(shape * np.arctan(z - curvature * (z - np.arctan(z))))
    left = 1.0 - (along / friction) ** 2
    return float(pure * np.sqrt(max(left, LEAST_GRIP_LEFT**2)))


@compiled
def _look_up(throttle: float, vx: float, drive_map: DriveMap) -> float:
    """Drive per mass, linear between the nodes of the map and constant beyond them."""
    i, a = _between(throttle, drive_map.throttles)
    j, b = _between(vx, drive_map.speeds_mps)
    drive = drive_map.drive_mps2
    low = (1.0 - b) * drive[i, j] + b * drive[i, j + 1]
    high = (1.0 - b) * drive[i + 1, j] + b * drive[i + 1, j + 1]
    return float((1.0 - a) * low + a * high)


@compiled
def _between(value: float, nodes: Array) -> tuple[int, float]:
    """Index of the node below, and the position between it and the next one, 0 to 1."""
    i = 0
    while i < len(nodes) - 2 and value > nodes[i + 1]:
        i += 1
    share = (value - nodes[i]) / (nodes[i + 1] - nodes[i])
    return i, min(max(share, 0.0), 1.0)
