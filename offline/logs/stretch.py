"""Stretches of a drive in which every signal is known, and its samples brought to one period."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offline.logs.column_mapping import Sampling
from offline.logs.log import Array
from offline.logs.series import Drive, Series

MUCH_FASTER = 2.0
"""samples a period from which a signal is averaged and no longer interpolated"""
_SLACK = 1e-6
"""of a period, so that rounding of stamps loses no sample"""


class Stretch(NamedTuple):
    """A time without gap."""

    begin_s: float
    end_s: float


def find_stretches(drive: Drive) -> list[Stretch]:
    """The times in which all signals of a drive are known, in order."""
    series = drive.all_series
    found = _known(series[0])
    for other in series[1:]:
        found = _intersect(found, _known(other))
    return found


def grid(stretch: Stretch, period_s: float) -> Array:
    """Instants (T,) of a stretch, a period apart, from its beginning on."""
    count = int((stretch.end_s - stretch.begin_s) / period_s + _SLACK) + 1
    return stretch.begin_s + period_s * np.arange(count, dtype=np.float64)


def resample(series: Series, stretch: Stretch, t_s: Array, period_s: float) -> Array:
    """The signal (T,) at these instants of a stretch, or over the periods after them.

    A signal recorded more than twice a period is averaged over the period around each instant,
    which takes out what the data set's period cannot show; any other is interpolated.
    """
    part = _cut(series, stretch)
    if series.sampling is Sampling.SAMPLED:
        if series.usual_step_s * MUCH_FASTER > period_s:
            return np.interp(t_s, part.t_s, part.values)
        # At a stretch's ends the window is narrower, on both sides: else it would be shifted.
        to_end = np.minimum(t_s - part.t_s[0], part.t_s[-1] - t_s)
        half = np.clip(to_end, 0.0, 0.5 * period_s)
        low, high = t_s - half, t_s + half
    else:
        low, high = t_s, t_s + period_s
    return window_mean(part.t_s, part.values, low, high, series.sampling is Sampling.HELD)


def window_mean(t_s: Array, values: Array, low_s: Array, high_s: Array, is_held: bool) -> Array:
    """Means (T,) over windows of a signal that is held, or linear, between its samples.

    Windows are cut at the signal's ends; one without width has the value there.
    """
    low, high = (np.clip(edge, t_s[0], t_s[-1]) for edge in (low_s, high_s))
    width = high - low
    area = _integral(t_s, values, high, is_held) - _integral(t_s, values, low, is_held)
    k = np.clip(np.searchsorted(t_s, low, side="right") - 1, 0, len(t_s) - 1)
    here = values[k] if is_held else np.interp(low, t_s, values)
    has_width = width > _SLACK * np.maximum(high_s - low_s, _SLACK)
    return np.where(has_width, area / np.where(has_width, width, 1.0), here)


def _integral(t_s: Array, values: Array, until_s: Array, is_held: bool) -> Array:
    """Integral of the signal from its first sample to each instant."""
    steps = np.diff(t_s)
    heights = values[:-1] if is_held else 0.5 * (values[:-1] + values[1:])
    whole = np.concatenate([[0.0], np.cumsum(heights * steps)])
    k = np.clip(np.searchsorted(t_s, until_s, side="right") - 1, 0, len(steps) - 1)
    rest = until_s - t_s[k]
    slope = np.zeros_like(rest) if is_held else np.diff(values)[k] / steps[k]
    return np.asarray(whole[k] + rest * (values[k] + 0.5 * slope * rest))


class _Part(NamedTuple):
    t_s: Array
    values: Array


def _cut(series: Series, stretch: Stretch) -> _Part:
    """The samples from the last one before a stretch to the first one after it."""
    first = max(int(np.searchsorted(series.t_s, stretch.begin_s, side="right")) - 1, 0)
    last = int(np.searchsorted(series.t_s, stretch.end_s, side="left"))
    return _Part(series.t_s[first : last + 1], series.values[first : last + 1])


def runs(is_true: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Begin and end of each unbroken run of truths."""
    edges = np.diff(np.concatenate([[0], is_true.astype(np.int8), [0]]))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return list(zip(begins.tolist(), ends.tolist(), strict=True))


def _known(series: Series) -> list[Stretch]:
    return [Stretch(float(series.t_s[a]), float(series.t_s[b])) for a, b in runs(series.bridged)]


def _intersect(some: list[Stretch], others: list[Stretch]) -> list[Stretch]:
    both: list[Stretch] = []
    i = j = 0
    while i < len(some) and j < len(others):
        begin = max(some[i].begin_s, others[j].begin_s)
        end = min(some[i].end_s, others[j].end_s)
        if end > begin:
            both.append(Stretch(begin, end))
        if some[i].end_s < others[j].end_s:
            i += 1
        else:
            j += 1
    return both
