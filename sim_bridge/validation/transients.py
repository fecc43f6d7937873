"""Test 5: step steer and frequency response, after ISO 7401."""

from dataclasses import dataclass
from math import radians

import numpy as np
from numpy import float64

from rt_controller.contract.arrays import Array
from sim_bridge.plant.parameters import Parameters
from sim_bridge.validation.cornering import steer_per_mps2
from sim_bridge.validation.run import Run, cruising_throttle, input_table, replay
from sim_bridge.validation.signal_metrics import (
    FrequencyResponse,
    StepResponse,
    frequency_response,
    largest_jump,
    sine_in,
    step_response,
)

STEP_SPEEDS_MPS = (80.0 / 3.6, 100.0 / 3.6)
WANTED_MPS2 = 4.0
STEER_RATE_RADPS = radians(500.0)
SWEEP_SPEED_MPS = 80.0 / 3.6
SWEEP_STEER_RAD = radians(15.0)
_STEP_AT_S = 0.5
_STEP_DURATION_S = 4.0
_INPUT_PERIOD_S = 0.005
_SETTLING_PERIODS = 2
_RECORDED_PERIODS = 3


@dataclass(frozen=True, slots=True)
class Step:
    """A step to 4 m/s^2 at one speed."""

    run: Run
    step_s: float
    """time at which the steering wheel has half of its final angle"""
    yaw_rate: StepResponse
    lateral: StepResponse


@dataclass(frozen=True, slots=True)
class Transients:
    """The runs and curves of test 5."""

    steps: tuple[Step, ...]
    yaw_rate: FrequencyResponse
    """in 1/s"""
    lateral: FrequencyResponse
    """in g per 100 deg"""


def measure(parameters: Parameters, frequency_hz: Array) -> tuple[Transients, dict[str, float]]:
    """Steps at both speeds, and sines at the given frequencies."""
    steps = tuple(_step(parameters, speed_mps) for speed_mps in STEP_SPEEDS_MPS)
    yaw_rate, lateral = sweep(parameters, frequency_hz)
    values: dict[str, float] = {}
    for speed_mps, step in zip(STEP_SPEEDS_MPS, steps, strict=True):
        at = f"{3.6 * speed_mps:.0f} km/h"
        values |= {
            f"t90 of yaw rate, {at}": step.yaw_rate.t90_s,
            f"overshoot of yaw rate, {at}": 100.0 * step.yaw_rate.overshoot,
            f"t90 of lateral acceleration, {at}": step.lateral.t90_s,
            f"steady lateral acceleration, {at}": step.lateral.steady,
        }
    for name, y in (("gain", yaw_rate.gain), ("phase", yaw_rate.phase_deg)):
        values[f"yaw {name} at 1 Hz"] = float(np.interp(1.0, yaw_rate.frequency_hz, y))
    for name, response in (("yaw", yaw_rate), ("lateral", lateral)):
        frequency_hz, log_gain = response.frequency_hz, np.log(response.gain)
        values[f"largest jump of the {name} gain"] = 100.0 * largest_jump(frequency_hz, log_gain)
        values[f"largest jump of the {name} phase"] = largest_jump(frequency_hz, response.phase_deg)
    return Transients(steps, yaw_rate, lateral), values


def _step(parameters: Parameters, speed_mps: float) -> Step:
    """The step whose steady lateral acceleration is 4 m/s^2; the angle is found by iteration."""
    throttle = cruising_throttle(parameters, speed_mps)
    angle_rad = WANTED_MPS2 * steer_per_mps2(parameters, speed_mps)
    time_s = _middles_s(_STEP_DURATION_S)
    for _ in range(6):
        steer_rad = np.clip(STEER_RATE_RADPS * (time_s - _STEP_AT_S), 0.0, angle_rad)
        inputs = input_table(len(time_s), throttle, steer_rad=steer_rad)
        run = replay(parameters, speed_mps, inputs, _INPUT_PERIOD_S)
        reached_mps2 = step_response(run.time_s, run.column("ay_mps2"), _STEP_AT_S).steady
        angle_rad *= WANTED_MPS2 / reached_mps2
    step_s = _STEP_AT_S + 0.5 * angle_rad / STEER_RATE_RADPS
    return Step(
        run,
        step_s,
        step_response(run.time_s, run.yaw_rate_degps, step_s),
        step_response(run.time_s, run.column("ay_mps2"), step_s),
    )


def sweep(
    parameters: Parameters, frequency_hz: Array
) -> tuple[FrequencyResponse, FrequencyResponse]:
    """Responses of yaw rate and lateral acceleration to the steering wheel angle."""
    throttle = cruising_throttle(parameters, SWEEP_SPEED_MPS)
    steer, yaw_rate, lateral = [], [], []
    for frequency in frequency_hz.tolist():
        middles_s = _middles_s((_SETTLING_PERIODS + _RECORDED_PERIODS) / frequency)
        steer_rad = SWEEP_STEER_RAD * np.sin(2.0 * np.pi * frequency * middles_s)
        inputs = input_table(len(middles_s), throttle, steer_rad=steer_rad)
        run = replay(parameters, SWEEP_SPEED_MPS, inputs, _INPUT_PERIOD_S)
        recorded = run.time_s >= _SETTLING_PERIODS / frequency
        time_s = run.time_s[recorded]
        # An input belongs to the middle of its period, the response to its end.
        steer.append(sine_in(time_s - 0.5 * _INPUT_PERIOD_S, run.steer_deg[recorded], frequency))
        yaw_rate.append(sine_in(time_s, run.yaw_rate_degps[recorded], frequency))
        lateral.append(sine_in(time_s, 100.0 * run.lateral_g[recorded], frequency))
    return (
        frequency_response(frequency_hz, steer, yaw_rate),
        frequency_response(frequency_hz, steer, lateral),
    )


def _middles_s(duration_s: float) -> Array:
    """Times of the middles of the input periods."""
    index = np.arange(round(duration_s / _INPUT_PERIOD_S), dtype=float64)
    return (index + 0.5) * _INPUT_PERIOD_S
