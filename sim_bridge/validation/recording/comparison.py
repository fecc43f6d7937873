"""How far a signal of the car is from the recorded one: pure functions of two signals."""

from dataclasses import dataclass
from math import nan

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from rt_controller.contract.arrays import Array

LARGEST_LAG_S = 0.5


@dataclass(frozen=True, slots=True)
class Comparison:
    """A signal of the car against the recorded one."""

    recording: str
    signal: str
    """with its unit, which is that of the two RMS values"""
    rms_recorded: float
    rms_error: float
    error_percent: float
    """RMS error over the RMS of the recorded signal"""
    gain: float
    """of the car over the recording, least squares: 1.1 if the car answers by a tenth too much"""
    lag_s: float
    """by which the recording comes after the car, for the smallest RMS error"""
    error_at_lag_percent: float
    """`error_percent` times the share that remains with the recording shifted by `lag_s`; the share
    is that of the samples which have 0.5 s of the compared part before and after them"""


def compare(
    recording: str,
    signal: str,
    recorded: Array,
    car: Array,
    period_s: float,
    is_compared: NDArray[np.bool_],
) -> Comparison:
    """The figures of two signals (n,) on the same even grid, of the samples `is_compared` (n,)."""
    measured, answer = recorded[is_compared], car[is_compared]
    size, error, power = rms(measured), rms(answer - measured), float(measured @ measured)
    lag_s, remaining = best_lag(recorded, car, period_s, is_compared)
    return Comparison(
        recording=recording,
        signal=signal,
        rms_recorded=size,
        rms_error=error,
        error_percent=_percent(error, size),
        gain=float(measured @ answer) / power if power > 0.0 else nan,
        lag_s=lag_s,
        error_at_lag_percent=remaining * _percent(error, size),
    )


def rms(values: Array) -> float:
    """Root of the mean square; NaN without values."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else nan


def best_lag(
    recorded: Array, car: Array, period_s: float, is_compared: NDArray[np.bool_]
) -> tuple[float, float]:
    """The lag in s of `recorded` behind `car` with the smallest RMS error, and its share.

    The share is that error over the one without lag; it is at most 1.

    Searched within 0.5 s; between samples by a parabola through the squared errors. All lags are
    compared over the same samples of the recording: those with 0.5 s of `is_compared` before and
    after them. NaN if there are none.
    """
    n = round(LARGEST_LAG_S / period_s)
    centre = binary_erosion(is_compared, np.ones(2 * n + 1))
    at = np.flatnonzero(centre)
    if not len(at):
        return nan, nan
    squares = np.array(
        [float(np.mean((car[at - lag] - recorded[at]) ** 2)) for lag in range(-n, n + 1)]
    )
    k = int(np.argmin(squares))
    shift, smallest = 0.0, float(squares[k])
    if 0 < k < len(squares) - 1:
        before, after = float(squares[k - 1]), float(squares[k + 1])
        bend = before - 2.0 * smallest + after
        if bend > 0.0:
            shift = 0.5 * (before - after) / bend
            smallest = max(0.0, smallest - 0.25 * (before - after) * shift)
    without_lag = float(squares[n])
    remaining = float(np.sqrt(smallest / without_lag)) if without_lag > 0.0 else 1.0
    return (k - n + shift) * period_s, remaining


def _percent(error: float, size: float) -> float:
    return 100.0 * error / size if size > 0.0 else nan
