"""Test 4: the plant with another model's parameters against that model itself.

The other model is the multi-body car of `commonroad-vehicle-models`, vehicle 2, as installed: its
code runs here, untouched. Both are steered by a ramp of the road wheel and hold their speed.
Althoff and Würsching, "CommonRoad: Vehicle Models", 2020.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy import float64

from rt_controller.contract.errors import MissingExtraError
from sim_bridge.plant.parameters import Parameters
from sim_bridge.validation.drivers import OpenLoopDriver, SpeedHold
from sim_bridge.validation.measures import step_response
from sim_bridge.validation.run import Array, cruising_throttle, drive

SPEED_MPS = 22.2
RATE_RADPS = 0.4
ROAD_WHEEL_RAD = (0.01, 0.02, 0.03, -0.01, -0.02, -0.03)
DURATION_S = 3.0
_PERIOD_S = 0.005
_STEP_S = 0.001
_HOLDING_PS = 5.0
_STEER, _VX, _YAW_RATE, _ROLL = 2, 3, 5, 6
"""positions in the other model's state"""


@dataclass(frozen=True, slots=True)
class Turn:
    """A ramp into a turn; left is positive, and positive roll lowers the right side."""

    time_s: Array
    yaw_rate_degps: Array
    roll_deg: Array

    @property
    def steady_yaw_rate_degps(self) -> float:
        return step_response(self.time_s, self.yaw_rate_degps, 0.0).steady

    @property
    def steady_roll_deg(self) -> float:
        return step_response(self.time_s, self.roll_deg, 0.0).steady

    @property
    def rise_s(self) -> float:
        """From the ramp's start to 90 % of the steady yaw rate."""
        return step_response(self.time_s, self.yaw_rate_degps, 0.0).t90_s


@dataclass(frozen=True, slots=True)
class Pair:
    """The same turn by both."""

    road_wheel_rad: float
    ours: Turn
    theirs: Turn


def measure(parameters: Parameters) -> tuple[Pair, ...]:
    """All turns of the test, by both cars.

    Raises:
        MissingExtraError: the other model is not installed.
    """
    their_rate, their_start = _their_model()
    throttle = cruising_throttle(parameters, SPEED_MPS)
    return tuple(
        Pair(
            angle_rad,
            _our_turn(parameters, throttle, angle_rad),
            _their_turn(their_rate, their_start, angle_rad),
        )
        for angle_rad in ROAD_WHEEL_RAD
    )


def _our_turn(parameters: Parameters, throttle: float, angle_rad: float) -> Turn:
    def steer_rad(time_s: float) -> float:
        return parameters.steering.ratio * float(
            np.clip(angle_rad, -RATE_RADPS * time_s, RATE_RADPS * time_s)
        )

    foot = SpeedHold(SPEED_MPS, throttle, _PERIOD_S)
    driver = OpenLoopDriver(lambda time_s: steer_rad(time_s + 0.5 * _PERIOD_S), foot)
    run = drive(parameters, SPEED_MPS, driver, DURATION_S, _PERIOD_S)
    return Turn(run.time_s, run.yaw_rate_degps, run.roll_deg)


Rate = Callable[[Array, tuple[float, float]], Array]
"""(state, (road-wheel rate in rad/s, acceleration in m/s^2)) to the state's rate"""


def _their_turn(rate: Rate, start: Array, angle_rad: float) -> Turn:
    """Midpoint steps; a turn to the left is theirs to the left too, but their roll counts the
    other way, since their vertical axis points down."""
    n_steps = round(DURATION_S / _STEP_S)
    states = np.empty((n_steps + 1, len(start)))
    states[0] = start
    for k in range(n_steps):
        x = states[k]
        inputs = (
            float(np.clip((angle_rad - x[_STEER]) / _STEP_S, -RATE_RADPS, RATE_RADPS)),
            float(_HOLDING_PS * (SPEED_MPS - x[_VX])),
        )
        middle = x + 0.5 * _STEP_S * rate(x, inputs)
        states[k + 1] = x + _STEP_S * rate(middle, inputs)
    return Turn(
        _STEP_S * np.arange(n_steps + 1, dtype=float64),
        np.degrees(states[:, _YAW_RATE]),
        -np.degrees(states[:, _ROLL]),
    )


def _their_model() -> tuple[Rate, Array]:
    try:
        from vehiclemodels.init_mb import init_mb
        from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
        from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb
    except ImportError as error:
        raise MissingExtraError(
            "The cross-check of test 4 needs commonroad-vehicle-models: expected the extra "
            "[commonroad], found it missing. Install it with: "
            'pip install -e ".[commonroad]"'
        ) from error
    parameters: Any = parameters_vehicle2()

    def rate(state: Array, inputs: tuple[float, float]) -> Array:
        return np.array(vehicle_dynamics_mb(state.tolist(), inputs, parameters))

    return rate, np.array(init_mb([0.0, 0.0, 0.0, SPEED_MPS, 0.0, 0.0, 0.0], parameters), float)
