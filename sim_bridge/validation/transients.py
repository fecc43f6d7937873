"""Test 5: step steer and frequency response, after ISO 7401."""

from dataclasses import dataclass
from math import radians

import numpy as np

from sim_bridge.plant.parameters import Parameters
from sim_bridge.validation.cornering import steer_per_mps2
from sim_bridge.validation.measures import (
    FrequencyResponse,
    StepResponse,
    frequency_response,
    sine_in,
    step_response,
)
from sim_bridge.validation.run import Array, Run, cruising_throttle, replay

STEP_SPEEDS_MPS = (80.0 / 3.6, 100.0 / 3.6)
WANTED_MPS2 = 4.0
STEER_RATE_RADPS = radians(500.0)
SWEEP_SPEED_MPS = 80.0 / 3.6
SWEEP_STEER_RAD = radians(15.0)
_STEP_AT_S = 0.5
_STEP_DURATION_S = 4.0
_PERIOD_S = 0.005
_SETTLING_PERIODS = 2
_RECORDED_PERIODS = 3


@dataclass(frozen=True, slots=True)
class Step:
    """A step to 4 m/s^2 at one speed."""

    run: Run
    step_s: float
    """when the steering wheel is halfway"""
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


def measure(parameters: Parameters, frequency_hz: Array) -> Transients:
    """Steps at both speeds, and sines at the frequencies."""
    yaw_rate, lateral = sweep(parameters, frequency_hz)
    return Transients(
        tuple(_step(parameters, speed_mps) for speed_mps in STEP_SPEEDS_MPS), yaw_rate, lateral
    )


def _step(parameters: Parameters, speed_mps: float) -> Step:
    """The angle is found by trial: what 4 m/s^2 takes near the limit, no small angle tells."""
    throttle = cruising_throttle(parameters, speed_mps)
    angle_rad = WANTED_MPS2 * steer_per_mps2(parameters, speed_mps)
    for _ in range(6):
        run = _step_run(parameters, speed_mps, throttle, angle_rad)
        reached_mps2 = step_response(run.time_s, run.seen("ay_mps2"), _STEP_AT_S).steady
        angle_rad *= WANTED_MPS2 / reached_mps2
    step_s = _STEP_AT_S + 0.5 * angle_rad / STEER_RATE_RADPS
    return Step(
        run,
        step_s,
        step_response(run.time_s, run.yaw_rate_degps, step_s),
        step_response(run.time_s, run.seen("ay_mps2"), step_s),
    )


def _step_run(parameters: Parameters, speed_mps: float, throttle: float, angle_rad: float) -> Run:
    time_s = (np.arange(round(_STEP_DURATION_S / _PERIOD_S)) + 0.5) * _PERIOD_S
    steer_rad = np.clip(STEER_RATE_RADPS * (time_s - _STEP_AT_S), 0.0, angle_rad)
    held = np.full_like(time_s, throttle)
    inputs = np.stack((held, np.zeros_like(time_s), steer_rad), axis=1)
    return replay(parameters, speed_mps, inputs, _PERIOD_S)


def sweep(
    parameters: Parameters, frequency_hz: Array
) -> tuple[FrequencyResponse, FrequencyResponse]:
    """Yaw rate and lateral acceleration against the steering wheel angle, a sine at a time."""
    throttle = cruising_throttle(parameters, SWEEP_SPEED_MPS)
    steer, yaw_rate, lateral = [], [], []
    for frequency in frequency_hz.tolist():
        run = _sine_run(parameters, throttle, frequency)
        recorded = run.time_s >= _SETTLING_PERIODS / frequency
        time_s = run.time_s[recorded]
        # an input stands for the middle of its period, the answers for its end
        steer.append(sine_in(time_s - 0.5 * _PERIOD_S, run.steer_deg[recorded], frequency))
        yaw_rate.append(sine_in(time_s, run.yaw_rate_degps[recorded], frequency))
        lateral.append(sine_in(time_s, 100.0 * run.lateral_g[recorded], frequency))
    return (
        frequency_response(frequency_hz, steer, yaw_rate),
        frequency_response(frequency_hz, steer, lateral),
    )


def _sine_run(parameters: Parameters, throttle: float, frequency_hz: float) -> Run:
    duration_s = (_SETTLING_PERIODS + _RECORDED_PERIODS) / frequency_hz
    time_s = (np.arange(round(duration_s / _PERIOD_S)) + 0.5) * _PERIOD_S
    inputs = np.stack(
        (
            np.full_like(time_s, throttle),
            np.zeros_like(time_s),
            SWEEP_STEER_RAD * np.sin(2.0 * np.pi * frequency_hz * time_s),
        ),
        axis=1,
    )
    return replay(parameters, SWEEP_SPEED_MPS, inputs, _PERIOD_S)
