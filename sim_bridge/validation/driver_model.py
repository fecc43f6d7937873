"""Drivers of the test manoeuvres: speed control, open-loop steering, and path preview.

The preview driver is optimal preview control: of all steering wheel angles that could be kept over
the preview time, it takes the one that keeps the predicted path closest to the wanted path, and
repeats this in every period. It predicts with a linear single-track model, fitted to the response
of the plant to small steps. The model does not include tyre saturation: near the limit the driver
increases the steering angle.
MacAdam, IEEE Trans. Systems, Man, and Cybernetics 11 (1981), pp. 393-399.
"""

from collections.abc import Callable
from math import radians
from typing import NamedTuple

import numpy as np
from numpy import float64

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import ControlInput, StateColumn
from sim_bridge.plant.parameters import Parameters
from sim_bridge.validation.run import (
    Observation,
    Run,
    cruising_throttle,
    input_table,
    replay,
    run_driver,
)

DRIVER_PERIOD_S = 0.01
_THROTTLE_PER_MPS, _THROTTLE_PER_M = 0.5, 0.3
_LEAD_LAG_S = 0.03
_TRIAL_S, _TRIAL_STEER_RAD, _TRIAL_HZ = 8.0, radians(8.0), 0.35

Path = Callable[[Array], Array]
"""from distances ahead in m to lateral positions in m, positive to the left"""


class SpeedControl:
    """Proportional-integral control of the speed with the throttle alone."""

    def __init__(self, speed_mps: float, throttle: float, period_s: float) -> None:
        self._speed_mps, self._integral, self._period_s = speed_mps, throttle, period_s

    def throttle(self, vx_mps: float) -> float:
        """The throttle of the next period; call once per period."""
        slower_mps = self._speed_mps - vx_mps
        step = _THROTTLE_PER_M * slower_mps * self._period_s
        self._integral = min(1.0, max(0.0, self._integral + step))
        return min(1.0, max(0.0, self._integral + _THROTTLE_PER_MPS * slower_mps))


def steer_open_loop(
    parameters: Parameters,
    speed_mps: float,
    steer_rad: Callable[[float], float],
    duration_s: float,
    period_s: float,
) -> Run:
    """A drive at constant speed, with the steering wheel angle as a function of time."""
    speed = SpeedControl(speed_mps, cruising_throttle(parameters, speed_mps), period_s)

    def driver(now: Observation) -> ControlInput:
        return ControlInput(speed.throttle(now.vx_mps), 0.0, steer_rad(now.time_s))

    return run_driver(parameters, speed_mps, driver, duration_s, period_s)


class DriverModel(NamedTuple):
    """Linear model of a car at one speed: next = A @ now + b * steer_rad, one driver period on."""

    speed_mps: float
    throttle: float
    """that keeps the speed"""
    A: Array
    """(2, 2), of vy_mps and yaw_rate_radps; b: (2,)"""
    b: Array


def fit_driver_model(parameters: Parameters, speed_mps: float) -> DriverModel:
    """The least-squares model of the response to small steps."""
    throttle = cruising_throttle(parameters, speed_mps)
    time_s = DRIVER_PERIOD_S * np.arange(round(_TRIAL_S / DRIVER_PERIOD_S), dtype=float64)
    steer_rad = _TRIAL_STEER_RAD * np.sign(np.sin(2.0 * np.pi * _TRIAL_HZ * time_s))
    inputs = input_table(len(time_s), throttle, steer_rad=steer_rad)
    run = replay(parameters, speed_mps, inputs, DRIVER_PERIOD_S)
    response = run.motion[:, StateColumn.vy_mps :]
    known = np.column_stack((response[:-1], steer_rad))
    solution = np.linalg.lstsq(known, response[1:], rcond=None)[0].astype(float64)
    return DriverModel(speed_mps, throttle, solution[:2].T, solution[2])


class PreviewDriver:
    """Steers along a path and keeps the speed.

    With a lead time it compensates the lag of the car, as trained drivers do: McRuer and Jex, IEEE
    Trans. Human Factors in Electronics 8 (1967), pp. 231-249.
    """

    def __init__(
        self, path_m: Path, preview_s: float, model: DriverModel, lead_s: float = 0.0
    ) -> None:
        self._path_m, self._lead_s, self._lagged_rad = path_m, lead_s, 0.0
        n_periods = round(preview_s / DRIVER_PERIOD_S)
        self._ahead_s = DRIVER_PERIOD_S * np.arange(1, n_periods + 1, dtype=float64)
        self._speed = SpeedControl(model.speed_mps, model.throttle, DRIVER_PERIOD_S)
        self._free = np.empty((n_periods, 4))
        """lateral position after each period by the state (vy, yaw rate, yaw, y)"""
        self._forced = np.empty(n_periods)
        """the same per radian of a constant steering wheel angle"""
        step = np.eye(4)
        step[:2, :2] = model.A
        step[2, 1] = step[3, 0] = DRIVER_PERIOD_S
        step[3, 2] = DRIVER_PERIOD_S * model.speed_mps
        steering = np.array((*model.b, 0.0, 0.0))
        power, response = np.eye(4), np.zeros(4)
        for k in range(n_periods):
            power = step @ power
            response = step @ response + steering
            self._free[k], self._forced[k] = power[3], response[3]

    def __call__(self, now: Observation) -> ControlInput:
        here = np.array((now.vy_mps, now.yaw_rate_radps, now.yaw_rad, now.y_m))
        gap_m = self._path_m(now.x_m + now.vx_mps * self._ahead_s) - self._free @ here
        steer_rad = float(gap_m @ self._forced / (self._forced @ self._forced))
        if self._lead_s > 0.0:
            # The angle advanced by the lead time, from its rate smoothed over `_LEAD_LAG_S`.
            rate_radps = (steer_rad - self._lagged_rad) / _LEAD_LAG_S
            self._lagged_rad += rate_radps * DRIVER_PERIOD_S
            steer_rad += self._lead_s * rate_radps
        return ControlInput(self._speed.throttle(now.vx_mps), 0.0, steer_rad)
