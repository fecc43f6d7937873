"""A recorded drive, and the two ways to make one: along given inputs, or with a driver.

Both start with a settled car on a straight at the speed asked for, on a wide flat place without
lanes: the pose is x, y and heading over ground.
"""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy import float64
from numpy.typing import NDArray

from rt_controller.contract.signals import ControlInput
from sim_bridge import frenet
from sim_bridge.plant.integrate import STEP_S, advance, glance, settle, simulate
from sim_bridge.plant.monitor import N_MONITOR, Monitor
from sim_bridge.plant.parameters import GRAVITY_MPS2, Parameters

Array = NDArray[float64]

_RELEASED = ControlInput(throttle=0.0, brake_n=0.0, steer_rad=0.0)


class Moment(NamedTuple):
    """What a driver knows when he chooses his next input."""

    time_s: float
    x_m: float
    y_m: float
    yaw_rad: float
    vx_mps: float
    vy_mps: float
    yaw_rate_radps: float


class Driver(Protocol):
    """Chooses the inputs that are held over the next period; may remember what he has seen."""

    def __call__(self, now: Moment) -> ControlInput: ...


@dataclass(frozen=True, slots=True)
class Run:
    """K periods of a drive; every column has K + 1 rows, the start among them."""

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
    def steer_deg(self) -> Array:
        return np.degrees(self.inputs[:, 2])

    @property
    def speed_mps(self) -> Array:
        return self.motion[:, 0]

    @property
    def yaw_rate_degps(self) -> Array:
        return np.degrees(self.motion[:, 2])

    @property
    def lateral_g(self) -> Array:
        return self.seen("ay_mps2") / GRAVITY_MPS2

    @property
    def sideslip_deg(self) -> Array:
        return np.degrees(self.seen("sideslip_rad"))

    @property
    def roll_deg(self) -> Array:
        return np.degrees(self.seen("roll_rad"))

    @property
    def loads_n(self) -> Array:
        """(K + 1, 4), front left, front right, rear left, rear right."""
        return self.monitor[:, _LOADS]

    @property
    def spins_radps(self) -> Array:
        """(K + 1, 4), as the loads."""
        return self.monitor[:, _SPINS]

    def seen(self, name: str) -> Array:
        """The column of the monitor that has this name."""
        return self.monitor[:, Monitor._fields.index(name)]


def _columns(kind: str) -> list[int]:
    wheels = ("front_left", "front_right", "rear_left", "rear_right")
    return [Monitor._fields.index(kind.format(wheel)) for wheel in wheels]


_LOADS = _columns("load_{}_n")
_SPINS = _columns("spin_{}_radps")


def replay(
    parameters: Parameters, v0_mps: float, inputs: Array, period_s: float, step_s: float = STEP_S
) -> Run:
    """The drive that `inputs` (K, 3), each row held for a period, make of a settled car."""
    steps = round(period_s / step_s)
    motion, monitor = simulate(settle(v0_mps, parameters), inputs, parameters, steps, step_s)
    pose = frenet.roll_out(motion, 0.0, 0.0, 0.0, steps, step_s)
    first = np.array([(*inputs[0, :2], 0.0)])
    return Run(period_s, np.vstack((first, inputs)), motion[::steps], pose, monitor)


def drive(
    parameters: Parameters,
    v0_mps: float,
    driver: Driver,
    duration_s: float,
    period_s: float = 0.01,
    step_s: float = STEP_S,
) -> Run:
    """The drive of a settled car with `driver` at its wheel."""
    n_periods = round(duration_s / period_s)
    steps = round(period_s / step_s)
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
    glance(state, *_RELEASED, parameters, run.monitor[0])
    for k in range(n_periods):
        chosen = driver(Moment(k * period_s, *run.pose[k].tolist(), *run.motion[k].tolist()))
        advance(state, *chosen, parameters, steps, step_s, piece)
        frenet.follow(run.motion[k], piece, 0.0, step_s, pose)
        run.inputs[k + 1] = chosen
        run.motion[k + 1] = piece[-1]
        run.pose[k + 1] = pose
        glance(state, *chosen, parameters, run.monitor[k + 1])
    return run


def cruising_throttle(parameters: Parameters, v0_mps: float) -> float:
    """The throttle that holds the speed on a straight."""
    row = np.empty(N_MONITOR)
    glance(settle(v0_mps, parameters), *_RELEASED, parameters, row)
    return float(row[Monitor._fields.index("throttle")])
