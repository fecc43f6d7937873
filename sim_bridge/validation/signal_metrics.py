"""Scalar quantities of recorded signals: the definitions behind the acceptance table.

A quantity that a record does not contain, such as the time to a speed that is not reached, is NaN.
"""

from math import nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array
from sim_bridge.validation.run import Run


def crossing(x: Array, y: Array, level: float) -> float:
    """x where y first reaches `level` from below, linear between samples; NaN if not reached."""
    above = y >= level
    if not above.any():
        return nan
    k = int(np.argmax(above))
    if k == 0:
        return float(x[0])
    share = (level - y[k - 1]) / (y[k] - y[k - 1])
    return float(x[k - 1] + share * (x[k] - x[k - 1]))


def slope(x: Array, y: Array, among: NDArray[np.bool_]) -> float:
    """Slope of y over x in the samples `among`, least squares with a free offset."""
    if np.count_nonzero(among) < 2:
        return nan
    return float(np.polyfit(x[among], y[among], 1)[0])


class StepResponse(NamedTuple):
    """Characteristics of the response of a signal to a step."""

    steady: float  # mean of the last tenth of the record
    t90_s: float  # from the step to 90 % of the steady value
    overshoot: float  # of the largest value over the steady one, a share of it


def step_response(time_s: Array, y: Array, step_s: float) -> StepResponse:
    """The response of `y` to a step at `step_s`: the time of half the input, after ISO 7401."""
    steady = float(np.mean(y[-max(1, len(y) // 10) :]))
    after = time_s >= step_s
    if not after.any() or steady == 0.0:
        return StepResponse(nan, nan, nan)
    share = y[after] / steady
    t90_s = crossing(time_s[after] - step_s, share, 0.9)
    return StepResponse(steady, t90_s, max(0.0, float(np.max(share)) - 1.0))


def sine_in(time_s: Array, y: Array, frequency_hz: float) -> complex:
    """The component of `y` at one frequency, least squares with a free offset and drift.

    Its absolute value is the amplitude, its angle the phase relative to time zero. If the record
    holds whole periods, harmonics have no influence.
    """
    angle = 2.0 * np.pi * frequency_hz * time_s
    basis = np.stack((np.sin(angle), np.cos(angle), np.ones_like(time_s), time_s), axis=1)
    in_phase, quadrature = np.linalg.lstsq(basis, y, rcond=None)[0][:2]
    return complex(in_phase, quadrature)


def mean_deceleration(run: Run, v0_mps: float) -> float:
    """Mean fully developed deceleration, m/s^2: between 80 % and 10 % of `v0_mps`.

    UN Regulation 13-H, annex 3: (v_b^2 - v_e^2) / (2 (s_e - s_b)).
    """
    begin_mps, end_mps = 0.8 * v0_mps, 0.1 * v0_mps
    begin_m, end_m = (crossing(run.x_m, -run.speed_mps, -v) for v in (begin_mps, end_mps))
    return (begin_mps**2 - end_mps**2) / (2.0 * (end_m - begin_m))


def rear_locked_first(rim_mps: Array, speed_mps: Array) -> bool:
    """True if a rear wheel locked while the front wheel on its side still turned.

    Args:
        rim_mps: (K, 4), wheel speeds times rolling radius, front left, front right, rear ones.
        speed_mps: (K,), of the car; below 3 m/s locking is ignored.
    """
    rolling = speed_mps > 3.0
    locked = rim_mps[rolling] < 0.2 * speed_mps[rolling, None]
    never = len(locked)
    first = [int(np.argmax(wheel)) if wheel.any() else never for wheel in locked.T]
    return first[2] < first[0] or first[3] < first[1]


def reversals(gear: Array) -> int:
    """Number of shifts with the opposite direction of the shift before."""
    shifts = np.sign(np.diff(gear))
    shifts = shifts[shifts != 0.0]
    return int(np.count_nonzero(np.diff(shifts)))
