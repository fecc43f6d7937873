"""Numbers out of recorded signals: pure functions of arrays, the definitions behind the table.

A number that a record does not contain, such as the time to a speed never reached, is NaN: it
fails every tolerance and needs no special case.
"""

from dataclasses import dataclass
from math import nan

import numpy as np
from numpy import float64
from numpy.typing import NDArray

Array = NDArray[float64]


def crossing(x: Array, y: Array, level: float) -> float:
    """x where y first reaches `level` from below, linear between samples; NaN if it never does."""
    above = y >= level
    if not above.any():
        return nan
    k = int(np.argmax(above))
    if k == 0:
        return float(x[0])
    share = (level - y[k - 1]) / (y[k] - y[k - 1])
    return float(x[k - 1] + share * (x[k] - x[k - 1]))


def slope(x: Array, y: Array, among: NDArray[np.bool_]) -> float:
    """Growth of y per x over the samples `among`, least squares with a free offset."""
    if np.count_nonzero(among) < 2:
        return nan
    return float(np.polyfit(x[among], y[among], 1)[0])


def peak(y: Array) -> float:
    """Largest size, without the sign."""
    return float(np.max(np.abs(y)))


@dataclass(frozen=True, slots=True)
class StepResponse:
    """How a signal answers a step."""

    steady: float
    """mean of the last tenth of the record"""
    t90_s: float
    """from the step to 90 % of the steady value"""
    peak_s: float
    """from the step to the largest value"""
    overshoot: float
    """of the largest value over the steady one, a share of it"""


def step_response(time_s: Array, y: Array, step_s: float) -> StepResponse:
    """The answer of `y` to a step at `step_s`. ISO 7401: the step is where the input is halfway."""
    steady = float(np.mean(y[-max(1, len(y) // 10) :]))
    after = time_s >= step_s
    since_s = time_s[after] - step_s
    share = y[after] / steady
    largest = int(np.argmax(share))
    return StepResponse(
        steady=steady,
        t90_s=crossing(since_s, share, 0.9),
        peak_s=float(since_s[largest]),
        overshoot=max(0.0, float(share[largest]) - 1.0),
    )


@dataclass(frozen=True, slots=True)
class Phasor:
    """A sine in a signal."""

    amplitude: float
    phase_rad: float
    """of the sine against time zero"""


def sine_in(time_s: Array, y: Array, frequency_hz: float) -> Phasor:
    """The part of `y` at one frequency, least squares with a free offset and drift.

    The record should hold whole periods; then the harmonics do not leak in.
    """
    angle = 2.0 * np.pi * frequency_hz * time_s
    basis = np.stack((np.sin(angle), np.cos(angle), np.ones_like(time_s), time_s), axis=1)
    in_phase, quadrature = np.linalg.lstsq(basis, y, rcond=None)[0][:2]
    return Phasor(float(np.hypot(in_phase, quadrature)), float(np.arctan2(quadrature, in_phase)))


@dataclass(frozen=True, slots=True)
class FrequencyResponse:
    """Gain and phase of an output against an input, by frequency."""

    frequency_hz: Array
    gain: Array
    phase_deg: Array
    """unwrapped; negative when the output lags"""


def frequency_response(
    frequency_hz: Array, inputs: list[Phasor], outputs: list[Phasor]
) -> FrequencyResponse:
    """Gain and phase out of one sine of input and output for each frequency."""
    gain = np.array([o.amplitude / i.amplitude for i, o in zip(inputs, outputs, strict=True)])
    phase = np.array([o.phase_rad - i.phase_rad for i, o in zip(inputs, outputs, strict=True)])
    first = np.angle(np.exp(1j * phase[:1]))
    unwrapped = np.unwrap(np.concatenate((first, phase[1:])))
    return FrequencyResponse(frequency_hz, gain, np.degrees(unwrapped))


def largest_jump(x: Array, y: Array) -> float:
    """How far a point lies from the line between its neighbours, at most.

    A smooth curve has small jumps however steep it is; a wrong point has a large one.
    """
    if len(y) < 3:
        return nan
    share = (x[1:-1] - x[:-2]) / (x[2:] - x[:-2])
    between = y[:-2] + share * (y[2:] - y[:-2])
    return float(np.max(np.abs(y[1:-1] - between)))


def mean_deceleration(time_s: Array, speed_mps: Array, v0_mps: float) -> float:
    """Mean fully developed deceleration, m/s^2: over the way from 80 % to 10 % of `v0_mps`.

    UN Regulation 13-H, annex 3: (v_b^2 - v_e^2) / (2 (s_e - s_b)).
    """
    way_m = distance(time_s, speed_mps)
    begin_mps, end_mps = 0.8 * v0_mps, 0.1 * v0_mps
    begin_m = crossing(way_m, -speed_mps, -begin_mps)
    end_m = crossing(way_m, -speed_mps, -end_mps)
    return (begin_mps**2 - end_mps**2) / (2.0 * (end_m - begin_m))


def distance(time_s: Array, speed_mps: Array) -> Array:
    """(K + 1,) way travelled, trapezoids between samples."""
    steps = 0.5 * (speed_mps[1:] + speed_mps[:-1]) * np.diff(time_s)
    return np.concatenate((np.zeros(1), np.cumsum(steps)))


def rear_locked_first(rim_mps: Array, speed_mps: Array, still_mps: float = 3.0) -> bool:
    """Whether a rear wheel locked while the front wheel on its side still turned.

    Args:
        rim_mps: (K, 4), wheel speeds times rolling radius, front left, front right, rear ones.
        speed_mps: (K,), of the car; below `still_mps` locking says nothing any more.
    """
    rolling = speed_mps > still_mps
    locked = rim_mps[rolling] < 0.2 * speed_mps[rolling, None]
    never = len(locked)
    first = [int(np.argmax(wheel)) if wheel.any() else never for wheel in locked.T]
    return first[2] < first[0] or first[3] < first[1]


def reversals(gear: Array) -> int:
    """How often a shift goes the other way than the shift before it."""
    shifts = np.sign(np.diff(gear))
    shifts = shifts[shifts != 0.0]
    return int(np.count_nonzero(np.diff(shifts)))


def largest_gain(energy_j: Array) -> float:
    """Largest growth of the energy from one sample to a later one, a share of the first.

    Zero for an energy that only falls.
    """
    lowest_before = np.minimum.accumulate(energy_j)
    return float(np.max(energy_j - lowest_before) / energy_j[0])
