"""Test 6: sine with dwell, after FMVSS 126; the car has no stability control to judge."""

from dataclasses import dataclass
from math import isfinite, nan, radians

import numpy as np
from numpy import float64

from sim_bridge.plant.parameters import Parameters
from sim_bridge.validation.measures import peak
from sim_bridge.validation.run import Array, Run, replay

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
_PERIOD_S = 0.005


@dataclass(frozen=True, slots=True)
class Dwell:
    """One run of the series."""

    amplitude_deg: float
    run: Run

    @property
    def second_peak_degps(self) -> float:
        """The yaw rate's peak after the steering wheel has changed sides."""
        half_s = START_S + 0.5 / FREQUENCY_HZ
        return peak(self.run.yaw_rate_degps[self.run.time_s > half_s])

    def left_over(self, after_s: float) -> float:
        """Yaw rate so long after the steering's end, a share of its peak."""
        then = np.interp(END_S + after_s, self.run.time_s, np.abs(self.run.yaw_rate_degps))
        return float(then) / self.second_peak_degps

    @property
    def displacement_m(self) -> float:
        """Way to the side 1.07 s after the steering's beginning."""
        return float(
            np.interp(START_S + DISPLACED_AFTER_S, self.run.time_s, np.abs(self.run.pose[:, 1]))
        )


@dataclass(frozen=True, slots=True)
class DwellSeries:
    """Rising amplitudes, up to 270 deg."""

    runs: tuple[Dwell, ...]
    wheel_angle_deg: float
    """at 0.3 g; the amplitudes are multiples of it"""

    def worst_left_over(self, after_s: float) -> float:
        return max((dwell.left_over(after_s) for dwell in self.runs), default=nan)

    @property
    def least_displacement_m(self) -> float:
        """Among the amplitudes large enough for the requirement to count."""
        large = _DISPLACEMENT_FACTOR * self.wheel_angle_deg
        return min(
            (dwell.displacement_m for dwell in self.runs if dwell.amplitude_deg >= large),
            default=nan,
        )


def measure(parameters: Parameters, wheel_angle_deg: float) -> DwellSeries:
    """The series for a car that takes `wheel_angle_deg` for 0.3 g; throttle closed at the start."""
    if not isfinite(wheel_angle_deg):  # a car that never gets to 0.3 g
        return DwellSeries((), wheel_angle_deg)
    amplitudes_rad = [radians(factor * wheel_angle_deg) for factor in _FACTORS]
    within = [a for a in amplitudes_rad if a < _LARGEST_RAD] + [_LARGEST_RAD]
    return DwellSeries(
        tuple(
            Dwell(float(np.degrees(a)), replay(parameters, SPEED_MPS, _inputs(a), _PERIOD_S))
            for a in within
        ),
        wheel_angle_deg,
    )


def _inputs(amplitude_rad: float) -> Array:
    time_s = _PERIOD_S * np.arange(0.5, round(_DURATION_S / _PERIOD_S), dtype=float64)
    steer_rad = amplitude_rad * sine_with_dwell(time_s - START_S)
    return np.stack((np.zeros_like(time_s), np.zeros_like(time_s), steer_rad), axis=1)


def sine_with_dwell(time_s: Array) -> Array:
    """One period of a sine of size 1 that rests in its second peak; zero before and after."""
    rest_from_s = 0.75 / FREQUENCY_HZ
    clock_s = np.where(time_s < rest_from_s, time_s, np.maximum(rest_from_s, time_s - DWELL_S))
    inside = (time_s >= 0.0) & (clock_s <= 1.0 / FREQUENCY_HZ)
    return np.where(inside, np.sin(2.0 * np.pi * FREQUENCY_HZ * clock_s), 0.0)
