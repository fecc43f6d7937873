"""Test 6: sine with dwell, after FMVSS 126; reported only: the car has no stability control."""

from dataclasses import dataclass
from math import isfinite, nan, radians

import numpy as np
from numpy import float64

from rt_controller.contract.arrays import Array
from sim_bridge.plant.parameters import Parameters
from sim_bridge.validation.run import Run, input_table, replay
from sim_bridge.validation.signal_metrics import peak

SPEED_MPS = 80.0 / 3.6
FREQUENCY_HZ = 0.7
DWELL_S = 0.5
START_S = 0.5
END_S = START_S + 1.0 / FREQUENCY_HZ + DWELL_S
_FACTORS = (1.5, 2.5, 3.5, 4.5, 5.5, 6.5)
_LARGEST_RAD = radians(270.0)
DISPLACED_AFTER_S = 1.07
_DISPLACEMENT_FACTOR = 5.0
_DURATION_S = 5.0
_INPUT_PERIOD_S = 0.005


@dataclass(frozen=True, slots=True)
class Dwell:
    """One run of the series."""

    amplitude_deg: float
    run: Run

    @property
    def second_peak_degps(self) -> float:
        """Peak of the yaw rate after the sign change of the steering wheel angle."""
        half_s = START_S + 0.5 / FREQUENCY_HZ
        return peak(self.run.yaw_rate_degps[self.run.time_s > half_s])


def measure(
    parameters: Parameters, wheel_angle_deg: float
) -> tuple[tuple[Dwell, ...], dict[str, float]]:
    """Runs with increasing amplitudes, up to 270 deg; the throttle is closed.

    Args:
        wheel_angle_deg: of the car at 0.3 g; the amplitudes are multiples of it. NaN for a car that
            does not reach 0.3 g: there are no runs then, and the values are NaN.
    """
    amplitudes_rad = [radians(factor * wheel_angle_deg) for factor in _FACTORS]
    amplitudes_rad = [a for a in amplitudes_rad if a < _LARGEST_RAD] + [_LARGEST_RAD]
    if not isfinite(wheel_angle_deg):
        amplitudes_rad = []
    runs = tuple(
        Dwell(float(np.degrees(a)), replay(parameters, SPEED_MPS, _inputs(a), _INPUT_PERIOD_S))
        for a in amplitudes_rad
    )
    # The requirement on the displacement holds from this amplitude on.
    large_deg = _DISPLACEMENT_FACTOR * wheel_angle_deg
    displaced_m = [
        float(np.interp(START_S + DISPLACED_AFTER_S, dwell.run.time_s, np.abs(dwell.run.y_m)))
        for dwell in runs
        if dwell.amplitude_deg >= large_deg
    ]
    return runs, {
        "yaw rate 1.00 s after the steering": 100.0 * _worst_remaining(runs, 1.0),
        "yaw rate 1.75 s after the steering": 100.0 * _worst_remaining(runs, 1.75),
        "lateral displacement after 1.07 s": min(displaced_m, default=nan),
    }


def _worst_remaining(runs: tuple[Dwell, ...], after_s: float) -> float:
    """Yaw rate at this time after the end of the steering, as a share of its second peak."""
    shares = []
    for dwell in runs:
        then = np.interp(END_S + after_s, dwell.run.time_s, np.abs(dwell.run.yaw_rate_degps))
        shares.append(float(then) / dwell.second_peak_degps)
    return max(shares, default=nan)


def _inputs(amplitude_rad: float) -> Array:
    time_s = _INPUT_PERIOD_S * np.arange(0.5, round(_DURATION_S / _INPUT_PERIOD_S), dtype=float64)
    steer_rad = amplitude_rad * sine_with_dwell(time_s - START_S)
    return input_table(len(time_s), steer_rad=steer_rad)


def sine_with_dwell(time_s: Array) -> Array:
    """One period of a sine of amplitude 1 with a dwell in its second peak, else zero."""
    dwell_from_s = 0.75 / FREQUENCY_HZ
    sine_s = np.where(time_s < dwell_from_s, time_s, np.maximum(dwell_from_s, time_s - DWELL_S))
    inside = (time_s >= 0.0) & (sine_s <= 1.0 / FREQUENCY_HZ)
    return np.where(inside, np.sin(2.0 * np.pi * FREQUENCY_HZ * sine_s), 0.0)
