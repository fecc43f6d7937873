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
from rt_controller.contract.errors import PlantError
from rt_controller.contract.physics import GRAVITY_MPS2
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, InputColumn, StateColumn
from sim_bridge import frenet
from sim_bridge.adapters.own_car import OwnCar
from sim_bridge.car import Car
from sim_bridge.plant.library import STEP_S, settle, simulate
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.protocol import PlantOutputs

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
    outputs: Array
    """(K + 1, N_OUTPUTS), columns as `PlantOutputs._fields`"""

    def __post_init__(self) -> None:
        """Raise a `PlantError` if the car failed."""
        if not self.is_finite:
            failed_s = self.time_s[int(np.argmin(np.isfinite(self.motion).all(axis=1)))]
            raise PlantError(
                f"test drive from {self.speed_mps[0]:.1f} m/s: expected a finite motion, found "
                f"none from {failed_s:.2f} s on. Correct the values of the car file."
            )

    @property
    def is_finite(self) -> bool:
        """True if motion and outputs are finite."""
        return bool(np.isfinite(self.motion).all() and np.isfinite(self.outputs).all())

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
        """(K + 1,) one of the outputs by its name."""
        return self.outputs[:, PlantOutputs._fields.index(name)]


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
    parameters: Parameters,
    v0_mps: float,
    inputs: Array,
    period_s: float,
    step_s: float = STEP_S,
    roads: Array | None = None,
) -> Run:
    """The drive of a settled car with `inputs` (K, 3), each row constant over a period.

    `roads` (K, 6) has a ground for each period, columns as `RoadParameters`.
    """
    steps = round(period_s / step_s)
    motion, outputs = simulate(settle(v0_mps, parameters), inputs, parameters, steps, step_s, roads)
    pose = frenet.integrate_poses(motion, 0.0, 0.0, 0.0, steps, step_s)
    first = inputs[:1].copy()
    first[:, InputColumn.steer_rad] = 0.0
    return Run(period_s, np.vstack((first, inputs)), motion[::steps], pose, outputs)


def run_driver(
    parameters: Parameters, v0_mps: float, driver: Driver, duration_s: float, period_s: float
) -> Run:
    """The drive of a settled car with a driver."""
    car = Car(OwnCar(parameters), v0_mps)
    rows = [_row(NEUTRAL_INPUT, car)]
    for k in range(round(duration_s / period_s)):
        _, motion, pose, _ = rows[-1]
        control = driver(Observation(k * period_s, *pose, *motion))
        car.advance(control, 0.0, period_s)
        rows.append(_row(control, car))
    return Run(period_s, *(np.array(part) for part in zip(*rows, strict=True)))


def _row(control: ControlInput, car: Car) -> tuple[tuple[float, ...], ...]:
    """Inputs, motion, pose and outputs; the pose on a straight road is that over ground."""
    vx_mps, vy_mps, yaw_rate_radps, _, ey_m, epsi_rad = car.state
    motion, pose = (vx_mps, vy_mps, yaw_rate_radps), (car.s_m, ey_m, epsi_rad)
    return control, motion, pose, car.plant.outputs()


def cruising_throttle(parameters: Parameters, v0_mps: float) -> float:
    """The throttle that keeps the speed on a straight road."""
    car = OwnCar(parameters)
    car.reset(v0_mps)
    return car.outputs().throttle
