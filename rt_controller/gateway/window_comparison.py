"""Two records of one quantity, compared over windows of a log: sign and factor.

Integrals and changes over a window are compared, not derivatives, so that noise has little effect.
The factor is a weighted median, so that jumps of a signal have little effect.
"""

from collections.abc import Sequence
from enum import Enum, auto
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from rt_controller.contract.arrays import Array

STEP_S = 0.05
LONGEST_GAP_S = 0.5
"""values are interpolated over shorter gaps"""
LONGEST_LOG_S = 4.0 * 3600.0
"""also of a log whose clock was set while it was recorded"""
LEAST_WINDOWS = 20
"""with motion; windows begin every `STEP_S`"""
OPPOSED_SHARE = 0.25
"""share of the motion that may have the other sign, of two records that agree"""
UNEXPECTED_MOTION = 3.0
"""times the least motion: a change without a cause that is no noise"""
CLEAR_MOTION = 2.5
"""times the least motion: noise cannot hide the relation"""
JUMP = 10.0
"""times the 90th percentile of the steps: a jump, such as of e_y at a lane boundary"""

Track = Sequence[tuple[float, float]]
"""time in s and SI value, of one signal"""


class Agreement(Enum):
    """How a record is related to the expected one."""

    TOO_LITTLE_MOTION = auto()
    SAME_SIGN = auto()
    OPPOSITE_SIGN = auto()
    NONE = auto()
    """neither sign"""
    UNCLEAR = auto()
    """neither sign, of little motion or of quantities that need not be related"""


class Comparison(NamedTuple):
    """What `compare` returns."""

    agreement: Agreement
    factor: float = 1.0
    """found = factor * expected, with its sign"""


def grid_of(tracks: Sequence[Track]) -> Array:
    """Times (N,) in s, every `STEP_S`, of the last `LONGEST_LOG_S` with samples; may be empty."""
    filled = [track for track in tracks if track]
    if not filled:
        return np.empty(0)
    start_s = min(time_s for track in filled for time_s, _ in track)
    end_s = max(time_s for track in filled for time_s, _ in track)
    return np.arange(max(start_s, end_s - LONGEST_LOG_S), end_s + STEP_S, STEP_S)


def on_grid(track: Track, times_s: Array) -> Array:
    """Values (N,) of a track at the times, NaN outside of it and in its gaps."""
    if len(track) < 2:
        return np.full(len(times_s), np.nan)
    sampled_s, values = np.array(sorted(track)).T
    found: Array = np.interp(times_s, sampled_s, values, left=np.nan, right=np.nan)
    after = np.clip(np.searchsorted(sampled_s, times_s), 1, len(sampled_s) - 1)
    found[sampled_s[after] - sampled_s[after - 1] > LONGEST_GAP_S] = np.nan
    return found


def integrals(values: Array, steps: int) -> Array:
    """Integral (N - steps,) over each window of a signal on the grid."""
    if len(values) <= steps:
        return np.empty(0)
    mean = 0.5 * (values[1:] + values[:-1])
    return np.asarray(STEP_S * sliding_window_view(mean, steps).sum(axis=1))


def changes(values: Array, steps: int, least_jump: float) -> Array:
    """Change (N - steps,) over each window, NaN where the signal jumps by `least_jump` or more."""
    if len(values) <= steps:
        return np.empty(0)
    step = np.diff(values)
    size = np.abs(step[np.isfinite(step)])
    if size.size:
        step[np.abs(step) > max(JUMP * np.percentile(size, 90.0), least_jump)] = np.nan
    return np.asarray(sliding_window_view(step, steps).sum(axis=1))


def centred(values: Array) -> Array:
    """Without the median, which is that of a constant bias of a sensor."""
    known = values[np.isfinite(values)]
    return values - np.median(known) if known.size else values


def compare(expected: Array, found: Array, least: float) -> Comparison:
    """Sign and factor of a record over the windows in which more than `least` is expected."""
    known = np.isfinite(expected) & np.isfinite(found)
    moving = known & (np.abs(expected) > least)
    if np.count_nonzero(moving) < LEAST_WINDOWS:
        unexpected = known & (np.abs(found) > UNEXPECTED_MOTION * least)
        if np.count_nonzero(unexpected) < LEAST_WINDOWS:
            return Comparison(Agreement.TOO_LITTLE_MOTION)
        return Comparison(Agreement.NONE, np.inf)
    if OPPOSED_SHARE < _opposed(expected[moving], found[moving]) < 1.0 - OPPOSED_SHARE:
        clear = known & (np.abs(expected) > CLEAR_MOTION * least)
        if np.count_nonzero(clear) < LEAST_WINDOWS:
            return Comparison(Agreement.UNCLEAR)
        moving = clear
    x, y = expected[moving], found[moving]
    opposed = _opposed(x, y)
    if OPPOSED_SHARE < opposed < 1.0 - OPPOSED_SHARE:
        return Comparison(Agreement.NONE)
    sign = Agreement.SAME_SIGN if opposed < 0.5 else Agreement.OPPOSITE_SIGN
    return Comparison(sign, _weighted_median(y / x, np.abs(x)))


def best_delay(expected: Array, found: Array, most_steps: int) -> Array:
    """`expected`, delayed by up to so many steps: the delay with the largest correlation."""
    delayed = [
        np.concatenate([np.full(k, np.nan), expected[: len(expected) - k]])
        for k in range(min(most_steps, len(expected)) + 1)
    ]
    return max(delayed, key=lambda each: correlation(each, found))


def correlation(x: Array, y: Array) -> float:
    """Size of the correlation of two records about 0, whatever its sign; 0 if one is 0."""
    both = np.isfinite(x) & np.isfinite(y)
    power = float(np.linalg.norm(x[both]) * np.linalg.norm(y[both]))
    return abs(float(x[both] @ y[both])) / power if power > 0.0 else 0.0


def _opposed(x: Array, y: Array) -> float:
    """Share of the motion x with the other sign of y."""
    return float(np.abs(x[x * y < 0.0]).sum() / np.abs(x).sum())


def _weighted_median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    summed = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(summed, 0.5 * summed[-1])])
