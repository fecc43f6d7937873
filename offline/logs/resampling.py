"""Times of a drive at which every signal is known, and its samples converted to one period."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offline.logs.series import LoggedDrive, Series
from rt_controller.contract.arrays import Array
from rt_controller.mapping.tables import Sampling

AVERAGED_FROM = 2.0
"""samples per period from which a signal is averaged instead of interpolated"""
_SLACK = 1e-6
"""of a period, so that rounding of time stamps loses no sample"""


class Stretch(NamedTuple):
    """A time interval without gap."""

    begin_s: float
    end_s: float


def find_stretches(drive: LoggedDrive) -> list[Stretch]:
    """The intervals in which all signals of a drive are known, in order."""
    changes = sorted(
        (float(series.t_s[k]), change)
        for series in drive.all_series
        for run in runs(series.connected)
        for k, change in zip(run, (1, -1), strict=True)
    )
    known, stretches = 0, []
    for (begin_s, change), (end_s, _) in pairwise(changes):
        known += change
        if known == len(drive.all_series):
            stretches.append(Stretch(begin_s, end_s))
    return stretches


def grid(stretch: Stretch, period_s: float) -> Array:
    """Instants (T,) one period apart, from the beginning of a stretch to its end."""
    count = int((stretch.end_s - stretch.begin_s) / period_s + _SLACK) + 1
    return stretch.begin_s + period_s * np.arange(count, dtype=np.float64)


def resample(series: Series, stretch: Stretch, t_s: Array, period_s: float) -> Array:
    """The signal (T,) at these instants of a stretch, or its means over the periods after them.

    A signal with more than two samples per period is averaged over the period around each instant,
    which removes what the data set's period cannot represent; others are interpolated linearly.
    """
    first = max(int(np.searchsorted(series.t_s, stretch.begin_s, side="right")) - 1, 0)
    last = int(np.searchsorted(series.t_s, stretch.end_s, side="left"))
    own_t_s, values = series.t_s[first : last + 1], series.values[first : last + 1]
    if series.sampling is not Sampling.SAMPLED:
        is_held = series.sampling is Sampling.HELD
        return window_mean(own_t_s, values, t_s, t_s + period_s, is_held)
    if series.usual_step_s * AVERAGED_FROM > period_s:
        return np.interp(t_s, own_t_s, values)
    # Near the ends of a stretch the window is narrower on both sides, so that it stays centred.
    to_end = np.minimum(t_s - own_t_s[0], own_t_s[-1] - t_s)
    half = np.clip(to_end, 0.0, 0.5 * period_s)
    return window_mean(own_t_s, values, t_s - half, t_s + half, is_held=False)


def window_mean(t_s: Array, values: Array, low_s: Array, high_s: Array, is_held: bool) -> Array:
    """Means (T,) over windows of a signal that is held, or linear, between its samples.

    Windows are limited to the signal's duration; a window of zero width gives the value there.
    """
    low, high = (np.clip(edge, t_s[0], t_s[-1]) for edge in (low_s, high_s))
    width = high - low
    area = _integral(t_s, values, high, is_held) - _integral(t_s, values, low, is_held)
    k = np.clip(np.searchsorted(t_s, low, side="right") - 1, 0, len(t_s) - 1)
    here = values[k] if is_held else np.interp(low, t_s, values)
    has_width = width > _SLACK * np.maximum(high_s - low_s, _SLACK)
    return np.where(has_width, area / np.where(has_width, width, 1.0), here)


def runs(is_true: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Begin and end of each unbroken run of true values."""
    edges = np.diff(np.concatenate([[0], is_true.astype(np.int8), [0]]))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return list(zip(begins.tolist(), ends.tolist(), strict=True))


def _integral(t_s: Array, values: Array, until_s: Array, is_held: bool) -> Array:
    """Integral of the signal from its first sample to each instant."""
    steps = np.diff(t_s)
    heights = values[:-1] if is_held else 0.5 * (values[:-1] + values[1:])
    complete = np.concatenate([[0.0], np.cumsum(heights * steps)])
    k = np.clip(np.searchsorted(t_s, until_s, side="right") - 1, 0, len(steps) - 1)
    rest = until_s - t_s[k]
    slope = np.zeros_like(rest) if is_held else np.diff(values)[k] / steps[k]
    return np.asarray(complete[k] + rest * (values[k] + 0.5 * slope * rest))
