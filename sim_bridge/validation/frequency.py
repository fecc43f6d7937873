"""Test 8: frequency responses at small angles of the steering wheel.

Sines at constant throttle; after the car has settled, the response is the Fourier coefficient over
whole periods.
"""

from dataclasses import dataclass
from math import nan, radians

import numpy as np
from numpy import float64

from rt_controller.contract.arrays import Array
from sim_bridge.plant.parameters import Parameters
from sim_bridge.validation.run import Run, cruising_throttle, input_table, replay
from sim_bridge.validation.signal_metrics import (
    FrequencyResponse,
    crossing,
    frequency_response,
    largest_jump,
    sine_in,
)

FAST_MPS, FAST_STEER_RAD = 80.0 / 3.6, radians(15.0)
SLOW_MPS, SLOW_STEER_RAD = 50.0 / 3.6, radians(20.0)
SLOW_HZ = np.array((0.2, 0.5, 1.0, 1.4, 1.8, 2.0, 2.2))
PHASES_HZ = (1.0, 1.4, 1.8)
_INPUT_PERIOD_S = 0.005
_SETTLING_PERIODS = 2
_LEAST_SETTLING_S = 2.0
_RECORDED_PERIODS = 3


@dataclass(frozen=True, slots=True)
class Responses:
    """Frequency responses of a car at one speed."""

    speed_mps: float
    yaw_rate: FrequencyResponse
    """to the steering wheel, 1/s"""
    lateral: FrequencyResponse
    """lateral acceleration to the steering wheel, g per 100 deg"""
    roll: FrequencyResponse
    """to the lateral acceleration, deg/g"""
    sideslip: FrequencyResponse
    """to the steering wheel, deg per deg"""


def measure(
    parameters: Parameters, frequency_hz: Array
) -> tuple[tuple[Responses, Responses], dict[str, float]]:
    """The responses at 80 km/h for the given frequencies, and at 50 km/h."""
    fast = sweep(parameters, FAST_MPS, FAST_STEER_RAD, frequency_hz)
    slow = sweep(parameters, SLOW_MPS, SLOW_STEER_RAD, SLOW_HZ)
    values = {
        "yaw gain at 0.2 Hz": at_hz(fast.yaw_rate, 0.2)[0],
        "lateral gain at 0.2 Hz": at_hz(fast.lateral, 0.2)[0],
        "roll at 0.2 Hz": at_hz(fast.roll, 0.2)[0],
        "frequency at which roll lags by 90 deg": crossing(
            slow.roll.frequency_hz, -slow.roll.phase_deg, 90.0
        ),
    }
    for name, response in (
        ("yaw", fast.yaw_rate),
        ("lateral", fast.lateral),
        ("roll", fast.roll),
        ("sideslip", fast.sideslip),
    ):
        values[f"{name} gain at 1 Hz"], values[f"{name} phase at 1 Hz"] = at_hz(response, 1.0)
    even = _evenly_spaced(frequency_hz)
    for name, response in (("yaw", fast.yaw_rate), ("lateral", fast.lateral)):
        log_gain = np.log(response.gain[even])
        values[f"largest jump of the {name} gain"] = 100.0 * largest_jump(log_gain)
        values[f"largest jump of the {name} phase"] = largest_jump(response.phase_deg[even])
    for hz in PHASES_HZ:
        yaw_deg = at_hz(slow.yaw_rate, hz)[1]
        values[f"yaw phase at {hz} Hz, 50 km/h"] = yaw_deg
        values[f"yaw phase at {hz} Hz, 50 km/h, against a single-track model"] = yaw_deg
        values[f"roll phase at {hz} Hz, 50 km/h"] = at_hz(slow.roll, hz)[1]
    return (fast, slow), values


def _evenly_spaced(frequency_hz: Array) -> slice:
    """The last frequencies with equal steps; a jump between uneven ones would be mere curvature."""
    steps_hz = np.diff(frequency_hz)
    uneven = np.flatnonzero(~np.isclose(steps_hz, steps_hz[-1]))
    return slice(int(uneven[-1]) + 1 if len(uneven) else 0, None)


def at_hz(response: FrequencyResponse, hz: float) -> tuple[float, float]:
    """Gain and phase (deg) at one of the frequencies; NaN if it was not measured."""
    there = np.isclose(response.frequency_hz, hz)
    if not there.any():
        return nan, nan
    return float(response.gain[there][0]), float(response.phase_deg[there][0])


def sweep(
    parameters: Parameters, speed_mps: float, steer_rad: float, frequency_hz: Array
) -> Responses:
    """The responses to sines with the amplitude `steer_rad` at the steering wheel."""
    throttle = cruising_throttle(parameters, speed_mps)
    steer, yaw_rate, lateral, roll, sideslip = [], [], [], [], []
    for frequency in frequency_hz.tolist():
        settling_s = max(_SETTLING_PERIODS, np.ceil(_LEAST_SETTLING_S * frequency)) / frequency
        run = _sine(parameters, speed_mps, throttle, steer_rad, frequency, settling_s)
        recorded = run.time_s >= settling_s
        time_s = run.time_s[recorded]
        # An input belongs to the middle of its period, the response to its end.
        steer.append(sine_in(time_s - 0.5 * _INPUT_PERIOD_S, run.steer_deg[recorded], frequency))
        yaw_rate.append(sine_in(time_s, run.yaw_rate_degps[recorded], frequency))
        lateral.append(sine_in(time_s, run.lateral_g[recorded], frequency))
        roll.append(sine_in(time_s, run.roll_deg[recorded], frequency))
        sideslip.append(sine_in(time_s, run.sideslip_deg[recorded], frequency))
    return Responses(
        speed_mps,
        frequency_response(frequency_hz, steer, yaw_rate),
        frequency_response(frequency_hz, steer, [100.0 * one for one in lateral]),
        frequency_response(frequency_hz, lateral, roll),
        frequency_response(frequency_hz, steer, sideslip),
    )


def _sine(
    parameters: Parameters,
    speed_mps: float,
    throttle: float,
    steer_rad: float,
    frequency_hz: float,
    settling_s: float,
) -> Run:
    """Whole periods of a sine at the steering wheel."""
    duration_s = settling_s + _RECORDED_PERIODS / frequency_hz
    index = np.arange(round(duration_s / _INPUT_PERIOD_S), dtype=float64)
    middles_s = (index + 0.5) * _INPUT_PERIOD_S
    wheel_rad = steer_rad * np.sin(2.0 * np.pi * frequency_hz * middles_s)
    inputs = input_table(len(index), throttle, steer_rad=wheel_rad)
    return replay(parameters, speed_mps, inputs, _INPUT_PERIOD_S)
