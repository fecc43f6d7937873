"""A driver who looks ahead along a path and knows how his car answers in everyday driving.

Optimal preview control: of all steering wheel angles that could be held over the preview time, he
takes the one that keeps the predicted way closest to the path, and chooses anew in every period.
He predicts with a linear single-track car, fitted to the plant's own answers to small steps, so
that he does not know that tyres saturate: near the limit he steers more, and more again.
MacAdam, IEEE Trans. Systems, Man, and Cybernetics 11 (1981), pp. 393-399.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import radians

import numpy as np
from numpy import float64

from rt_controller.contract.signals import ControlInput
from sim_bridge.plant.parameters import Parameters
from sim_bridge.validation.drivers import SpeedHold
from sim_bridge.validation.run import Array, Moment, cruising_throttle, replay

PERIOD_S = 0.01
_TRIAL_S = 8.0
_TRIAL_STEER_RAD = radians(8.0)
_TRIAL_HZ = 0.35

Path = Callable[[Array], Array]
"""ways ahead in m to ways to the left in m"""


@dataclass(frozen=True, slots=True)
class Familiarity:
    """How a car answers at one speed: next = free @ now + forced * steer_rad, a period on."""

    speed_mps: float
    throttle: float
    """that holds the speed"""
    free: Array
    """(2, 2), of vy_mps and yaw_rate_radps"""
    forced: Array
    """(2,)"""


def get_familiar(parameters: Parameters, speed_mps: float) -> Familiarity:
    """What small steps to both sides teach of the car, least squares."""
    throttle = cruising_throttle(parameters, speed_mps)
    time_s = PERIOD_S * np.arange(round(_TRIAL_S / PERIOD_S), dtype=float64)
    steer_rad = _TRIAL_STEER_RAD * np.sign(np.sin(2.0 * np.pi * _TRIAL_HZ * time_s))
    held = np.full_like(time_s, throttle)
    inputs = np.stack((held, np.zeros_like(held), steer_rad), axis=1)
    motion = replay(parameters, speed_mps, inputs, PERIOD_S).motion[:, 1:]
    known = np.column_stack((motion[:-1], steer_rad))
    answer = np.linalg.lstsq(known, motion[1:], rcond=None)[0].astype(float64)
    return Familiarity(speed_mps, throttle, answer[:2].T, answer[2])


class PreviewDriver:
    """Steers along a path and holds the speed."""

    def __init__(self, path_m: Path, preview_s: float, car: Familiarity) -> None:
        self._path_m = path_m
        self._ahead_s = PERIOD_S * np.arange(1, round(preview_s / PERIOD_S) + 1, dtype=float64)
        self._free, self._forced = _ways_aside(car, len(self._ahead_s))
        self._foot = SpeedHold(car.speed_mps, car.throttle, PERIOD_S)

    def __call__(self, now: Moment) -> ControlInput:
        here = np.array((now.vy_mps, now.yaw_rate_radps, now.yaw_rad, now.y_m))
        gap_m = self._path_m(now.x_m + now.vx_mps * self._ahead_s) - self._free @ here
        steer_rad = float(gap_m @ self._forced / (self._forced @ self._forced))
        return ControlInput(self._foot.throttle(now.vx_mps), 0.0, steer_rad)


def _ways_aside(car: Familiarity, n_periods: int) -> tuple[Array, Array]:
    """Way to the left after each period, of the state (vy, yaw rate, yaw, y) and of the steering.

    Returns:
        (n_periods, 4) without steering, (n_periods,) per radian held at the steering wheel.
    """
    step = np.eye(4)
    step[:2, :2] = car.free
    step[2, 1] = PERIOD_S
    step[3, 0] = PERIOD_S
    step[3, 2] = PERIOD_S * car.speed_mps
    push = np.array((*car.forced, 0.0, 0.0))
    free = np.empty((n_periods, 4))
    forced = np.empty(n_periods)
    power, pushed = np.eye(4), np.zeros(4)
    for k in range(n_periods):
        power = step @ power
        pushed = step @ pushed + push
        free[k] = power[3]
        forced[k] = pushed[3]
    return free, forced
