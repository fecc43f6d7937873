"""Test 5: step steer, after ISO 7401."""

from dataclasses import dataclass
from math import nan, radians

import numpy as np
from numpy import float64

from sim_bridge.plant.parameters import Parameters
from sim_bridge.validation.cornering import steer_per_mps2
from sim_bridge.validation.run import Run, cruising_throttle, input_table, replay
from sim_bridge.validation.signal_metrics import StepResponse, step_response

STEP_SPEEDS_MPS = (80.0 / 3.6, 100.0 / 3.6)
WANTED_MPS2 = 4.0
STEER_RATE_RADPS = radians(500.0)
_STEP_AT_S = 0.5
_STEP_DURATION_S = 4.0
_INPUT_PERIOD_S = 0.005


@dataclass(frozen=True, slots=True)
class Step:
    """A step to 4 m/s^2 at one speed."""

    run: Run
    step_s: float
    """time at which the steering wheel has half of its final angle"""
    yaw_rate: StepResponse
    lateral: StepResponse


def measure(parameters: Parameters) -> tuple[tuple[Step, ...], dict[str, float]]:
    """Steps to 4 m/s^2 at both speeds."""
    steps = tuple(_step(parameters, speed_mps) for speed_mps in STEP_SPEEDS_MPS)
    values: dict[str, float] = {}
    for speed_mps, step in zip(STEP_SPEEDS_MPS, steps, strict=True):
        at = f"{3.6 * speed_mps:.0f} km/h"
        values |= {
            f"t90 of yaw rate, {at}": step.yaw_rate.t90_s,
            f"overshoot of yaw rate, {at}": 100.0 * step.yaw_rate.overshoot,
            f"t90 of lateral acceleration, {at}": step.lateral.t90_s,
        }
    return steps, values


def _step(parameters: Parameters, speed_mps: float) -> Step:
    """The step whose steady lateral acceleration is 4 m/s^2; the angle is found by iteration."""
    throttle = cruising_throttle(parameters, speed_mps)
    angle_rad = WANTED_MPS2 * steer_per_mps2(parameters, speed_mps)
    index = np.arange(round(_STEP_DURATION_S / _INPUT_PERIOD_S), dtype=float64)
    time_s = (index + 0.5) * _INPUT_PERIOD_S  # the middles of the input periods
    for _ in range(6):
        steer_rad = np.clip(STEER_RATE_RADPS * (time_s - _STEP_AT_S), 0.0, angle_rad)
        inputs = input_table(len(time_s), throttle, steer_rad=steer_rad)
        run = replay(parameters, speed_mps, inputs, _INPUT_PERIOD_S)
        reached_mps2 = step_response(run.time_s, run.column("ay_mps2"), _STEP_AT_S).steady
        # A car that does not turn has no such angle.
        angle_rad *= WANTED_MPS2 / reached_mps2 if reached_mps2 > 0.0 else nan
    step_s = _STEP_AT_S + 0.5 * angle_rad / STEER_RATE_RADPS
    return Step(
        run,
        step_s,
        step_response(run.time_s, run.yaw_rate_degps, step_s),
        step_response(run.time_s, run.column("ay_mps2"), step_s),
    )
