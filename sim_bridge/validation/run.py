"""`Run`: a recorded test drive, made with given inputs (`replay`) or by a driver (`run_driver`).

Both begin with a settled car at the given speed on an unlimited plane without lanes: the pose is x,
y and heading over ground.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy import float64

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import PlantError
from rt_controller.contract.signals import (
    GRAVITY_MPS2,
    NEUTRAL_INPUT,
    ControlInput,
    InputColumn,
    StateColumn,
)
from sim_bridge import frenet
from sim_bridge.adapters.own_car import OwnCar
from sim_bridge.car import Car
from sim_bridge.plant.library import STEP_S, settle, simulate
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.protocol import PlantOutputs

PER_KMH = 1.0 / 3.6
"""m/s"""
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


class Run:
    """A drive of K periods; every array has K + 1 rows, the first is the start.

    An input belongs to the period that ends with its row. The columns of `motion` are vx_mps,
    vy_mps and yaw_rate_radps, those of `pose` x_m, y_m and yaw_rad over ground, those of `outputs`
    `PlantOutputs._fields`, those of `loads_n` and `spins_radps` the wheels front left, front right,
    rear left, rear right.
    """

    def __init__(
        self, period_s: float, inputs: Array, motion: Array, pose: Array, outputs: Array
    ) -> None:
        """Raise a `PlantError` if the car failed."""
        self.period_s, self.inputs = period_s, inputs
        self.motion, self.pose, self.outputs = motion, pose, outputs
        self.time_s: Array = period_s * np.arange(len(motion), dtype=float64)
        self.x_m, self.y_m = pose[:, 0], pose[:, 1]
        self.speed_mps = motion[:, StateColumn.vx_mps]
        if not (np.isfinite(motion).all() and np.isfinite(outputs).all()):
            failed_s = self.time_s[int(np.argmin(np.isfinite(motion).all(axis=1)))]
            raise PlantError(
                f"test drive from {self.speed_mps[0]:.1f} m/s: expected a finite motion, found "
                f"none from {failed_s:.2f} s on. Correct the values of the car file."
            )
        self.steer_deg = np.degrees(inputs[:, InputColumn.steer_rad])
        self.yaw_rate_degps = np.degrees(motion[:, StateColumn.yaw_rate_radps])
        self.lateral_g = self.column("ay_mps2") / GRAVITY_MPS2
        self.sideslip_deg = np.degrees(self.column("sideslip_rad"))
        self.roll_deg = np.degrees(self.column("roll_rad"))
        self.loads_n = np.stack([self.column(f"load_{wheel}_n") for wheel in _WHEELS], axis=1)
        self.spins_radps = np.stack(
            [self.column(f"spin_{wheel}_radps") for wheel in _WHEELS], axis=1
        )

    def column(self, name: str) -> Array:
        """(K + 1,) one of the outputs by its name."""
        return self.outputs[:, PlantOutputs._fields.index(name)]


Measured = dict[str, float]
"""the result of a manoeuvre: values by the name of the line"""


def input_table(
    n: int,
    throttle: Array | float = 0.0,
    brake_n: Array | float = 0.0,
    steer_rad: Array | float = 0.0,
) -> Array:
    """(n, 3) inputs, columns as `ControlInput`, from constants or arrays (n,)."""
    columns = [np.broadcast_to(column, n) for column in (throttle, brake_n, steer_rad)]
    return np.stack(columns, axis=1, dtype=float64)


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
    car, control = Car(OwnCar(parameters), v0_mps), NEUTRAL_INPUT
    rows: list[tuple[Sequence[float], ...]] = []
    for k in range(round(duration_s / period_s) + 1):
        if k > 0:
            _, motion, pose, _ = rows[-1]
            control = driver(Observation((k - 1) * period_s, *pose, *motion))
            car.advance(control, 0.0, period_s)
        vx_mps, vy_mps, yaw_rate_radps, _, ey_m, epsi_rad = car.state
        # The pose on a straight road is that over ground.
        motion, pose = (vx_mps, vy_mps, yaw_rate_radps), (car.s_m, ey_m, epsi_rad)
        rows.append((control, motion, pose, car.plant.outputs()))
    return Run(period_s, *(np.array(part) for part in zip(*rows, strict=True)))


def cruising_throttle(parameters: Parameters, v0_mps: float) -> float:
    """The throttle that keeps the speed on a straight road."""
    car = OwnCar(parameters)
    car.reset(v0_mps)
    return car.outputs().throttle
