"""`Run`: a recorded test drive, made with given inputs (`replay`) or by a driver (`run_driver`).

Both begin with a settled car at the given speed on an unlimited plane without lanes: the pose is x,
y and heading over ground.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy import float64

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, InputColumn, StateColumn
from sim_bridge import frenet
from sim_bridge.plant.car_parts import GRAVITY_MPS2
from sim_bridge.plant.integrate import STEP_S, advance, settle, simulate, write_monitor
from sim_bridge.plant.monitor import N_MONITOR, Monitor
from sim_bridge.plant.parameters import Parameters

_WHEELS = ("front_left", "front_right", "rear_left", "rear_right")


class Observation(NamedTuple):
    """Input of a driver: time, position and motion of the car."""

    time_s: float
    x_m: float
    y_m: float
    yaw_rad: float
    vx_mps: float
    vy_mps: float
    yaw_rate_radps: float


Driver = Callable[[Observation], ControlInput]
"""chooses the inputs of the next period; may have a state"""


@dataclass(frozen=True, slots=True)
class Run:
    """A drive of K periods; every array has K + 1 rows, the first is the start."""

    period_s: float
    inputs: Array
    """(K + 1, 3), columns as `ControlInput`; a row holds for the period that ends with it"""
    motion: Array
    """(K + 1, 3), vx_mps, vy_mps, yaw_rate_radps"""
    pose: Array
    """(K + 1, 3), x_m, y_m, yaw_rad over ground"""
    monitor: Array
    """(K + 1, N_MONITOR), columns as `Monitor._fields`"""

    @property
    def time_s(self) -> Array:
        return self.period_s * np.arange(len(self.motion), dtype=float64)

    @property
    def x_m(self) -> Array:
        return self.pose[:, 0]

    @property
    def y_m(self) -> Array:
        return self.pose[:, 1]

    @property
    def steer_deg(self) -> Array:
        return np.degrees(self.inputs[:, InputColumn.steer_rad])

    @property
    def speed_mps(self) -> Array:
        return self.motion[:, StateColumn.vx_mps]

    @property
    def yaw_rate_degps(self) -> Array:
        return np.degrees(self.motion[:, StateColumn.yaw_rate_radps])

    @property
    def lateral_g(self) -> Array:
        return self.column("ay_mps2") / GRAVITY_MPS2

    @property
    def sideslip_deg(self) -> Array:
        return np.degrees(self.column("sideslip_rad"))

    @property
    def roll_deg(self) -> Array:
        return np.degrees(self.column("roll_rad"))

    @property
    def loads_n(self) -> Array:
        """(K + 1, 4), front left, front right, rear left, rear right."""
        return np.stack([self.column(f"load_{wheel}_n") for wheel in _WHEELS], axis=1)

    @property
    def spins_radps(self) -> Array:
        """(K + 1, 4), order as `loads_n`."""
        return np.stack([self.column(f"spin_{wheel}_radps") for wheel in _WHEELS], axis=1)

    def column(self, name: str) -> Array:
        """(K + 1,) a column of the monitor by its name."""
        return self.monitor[:, Monitor._fields.index(name)]


def input_table(
    n: int,
    throttle: Array | float = 0.0,
    brake_n: Array | float = 0.0,
    steer_rad: Array | float = 0.0,
) -> Array:
    """(n, 3) inputs, columns as `ControlInput`, from constants or arrays (n,)."""
    table = np.empty((n, len(InputColumn)))
    table[:, InputColumn.throttle] = throttle
    table[:, InputColumn.brake_n] = brake_n
    table[:, InputColumn.steer_rad] = steer_rad
    return table


def replay(
    parameters: Parameters, v0_mps: float, inputs: Array, period_s: float, step_s: float = STEP_S
) -> Run:
    """The drive of a settled car with `inputs` (K, 3), each row constant over a period."""
    steps = round(period_s / step_s)
    motion, monitor = simulate(settle(v0_mps, parameters), inputs, parameters, steps, step_s)
    pose = frenet.integrate_poses(motion, 0.0, 0.0, 0.0, steps, step_s)
    first = inputs[:1].copy()
    first[:, InputColumn.steer_rad] = 0.0
    return Run(period_s, np.vstack((first, inputs)), motion[::steps], pose, monitor)


def run_driver(
    parameters: Parameters, v0_mps: float, driver: Driver, duration_s: float, period_s: float = 0.01
) -> Run:
    """The drive of a settled car with a driver."""
    n_periods = round(duration_s / period_s)
    steps = round(period_s / STEP_S)
    state = settle(v0_mps, parameters)
    piece = np.empty((steps, 3))
    run = Run(
        period_s,
        np.zeros((n_periods + 1, 3)),
        np.empty((n_periods + 1, 3)),
        np.empty((n_periods + 1, 3)),
        np.empty((n_periods + 1, N_MONITOR)),
    )
    pose = np.zeros(3)
    run.motion[0] = (v0_mps, 0.0, 0.0)
    run.pose[0] = pose
    write_monitor(state, NEUTRAL_INPUT, parameters, run.monitor[0])
    for k in range(n_periods):
        now = Observation(k * period_s, *run.pose[k].tolist(), *run.motion[k].tolist())
        control = driver(now)
        advance(state, control, parameters, steps, STEP_S, piece)
        frenet.advance_pose(run.motion[k], piece, 0.0, STEP_S, pose)
        run.inputs[k + 1] = control
        run.motion[k + 1] = piece[-1]
        run.pose[k + 1] = pose
        write_monitor(state, control, parameters, run.monitor[k + 1])
    return run


def cruising_throttle(parameters: Parameters, v0_mps: float) -> float:
    """The throttle that keeps the speed on a straight road."""
    row = np.empty(N_MONITOR)
    write_monitor(settle(v0_mps, parameters), NEUTRAL_INPUT, parameters, row)
    return float(row[Monitor._fields.index("throttle")])
