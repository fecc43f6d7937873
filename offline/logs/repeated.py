"""Logs that have the same samples: a test on them would be one on the training data.

File names, formats and times of the clock do not matter; values and steps of time do.
"""

from collections.abc import Iterator, Sequence
from hashlib import sha256
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offline.logs.episode import LEAST_SAMPLES
from offline.logs.signal import LoggedDrive, LogSignal
from rt_controller.contract.arrays import Array

_CHANGES = 24
"""of a signal, from which on two drives are compared"""
_TIME_TOLERANCE_S, _VALUE_TOLERANCE = 1e-3, 1e-5
"""for numbers that were written with other digits; the second is relative"""
_FACTOR = 0x9E3779B97F4A7C15
"""odd, so that it has an inverse modulo 2**64"""


class _Common(NamedTuple):
    """The place of equal changes of one signal in two drives."""

    drives: tuple[int, int]
    begins_s: tuple[float, float]


def find_repeated(drives: Sequence[LoggedDrive], period_s: float) -> list[str]:
    """A sentence for each drive that has a stretch as long as a window in common with another."""
    shortest_s = LEAST_SAMPLES * period_s
    found: dict[tuple[int, int], str] = {}
    equal: dict[bytes, int] = {}
    for k, drive in enumerate(drives):
        digest = sha256()
        for each in drive.signals:
            digest.update(each.values.tobytes())
        first = equal.setdefault(digest.digest(), k)
        if first != k:
            found[first, k] = "everywhere"
    copies = {k for _, k in found}
    for same in zip(*(drive.signals for drive in drives), strict=True):
        for common in _common_changes(same):
            if common.drives in found or copies & set(common.drives):
                continue
            one, other = (drives[k] for k in common.drives)
            begins_s = _common_stretch(one, other, common.begins_s, shortest_s)
            if begins_s is not None:
                places = f"{begins_s[1]:.4g} s on, there {begins_s[0]:.4g} s on"
                found[common.drives] = f"among others from {places}"
    return [
        f"{drives[k].signals[0].column.path} has the same samples as {drives[first].name}, "
        f"{where}: a test on one of them is a test on training data. Leave one out, or the part "
        f"that they share; if they are different drives, write accept_repeated = true in [checks]."
        for (first, k), where in found.items()
    ]


def _common_changes(same: Sequence[LogSignal]) -> Iterator[_Common]:
    """Places where a signal changes equally in two drives, for the same length of time."""
    parts = [_changes(signal) for signal in same]
    known = [k for k, part in enumerate(parts) if len(part[0])]
    if len(known) < 2:
        return
    blocks = [parts[k][0][::_CHANGES] for k in known]
    owner = np.repeat(known, [len(block) for block in blocks])
    place = np.concatenate([_CHANGES * np.arange(len(block)) for block in blocks])
    hashes, first = np.unique(np.concatenate(blocks), return_index=True)
    for k in known:
        own, begin_s, span_s = parts[k]
        at = np.minimum(np.searchsorted(hashes, own), len(hashes) - 1)
        for i in np.flatnonzero((hashes[at] == own) & (owner[first[at]] < k)):
            other, j = int(owner[first[at[i]]]), int(place[first[at[i]]])
            _, other_begin_s, other_span_s = parts[other]
            if abs(span_s[i] - other_span_s[j]) <= 2.0 * _TIME_TOLERANCE_S:
                yield _Common((other, k), (float(other_begin_s[j]), float(begin_s[i])))


def _changes(signal: LogSignal) -> tuple[NDArray[np.uint64], Array, Array]:
    """Hash (M,) of every `_CHANGES` successive changes of a signal, their begin and length in s."""
    rounded = signal.values.astype(np.float32) + np.float32(0.0)  # no negative zero
    codes = ((rounded.view(np.uint32).astype(np.uint64) + 8) >> 4).astype(np.uint64)
    is_new = np.flatnonzero(np.diff(codes, prepend=codes[:1] + np.uint64(1)))
    codes, t_s = codes[is_new], signal.t_s[is_new]
    if len(codes) <= _CHANGES:
        return np.zeros(0, np.uint64), np.zeros(0), np.zeros(0)
    powers, inverses = (
        np.cumprod(np.full(len(codes), factor, np.uint64), dtype=np.uint64)
        for factor in (_FACTOR, pow(_FACTOR, -1, 2**64))
    )
    sums = np.concatenate([np.zeros(1, np.uint64), np.cumsum(codes * powers, dtype=np.uint64)])
    count = len(codes) - _CHANGES
    hashes = (sums[_CHANGES:-1] - sums[:count]) * inverses[:count]
    return hashes, t_s[:count], t_s[_CHANGES:] - t_s[:count]


def _common_stretch(
    first: LoggedDrive, second: LoggedDrive, begins_s: tuple[float, float], shortest_s: float
) -> tuple[float, float] | None:
    """Begin of a stretch of both drives with equal samples of all signals, or None."""
    ahead_s = begins_s[0] - begins_s[1]
    low_s = max(_extent(first)[0], _extent(second)[0] + ahead_s)
    high_s = min(_extent(first)[1], _extent(second)[1] + ahead_s)
    end_s = min(begins_s[0] + shortest_s, high_s)
    begin_s = max(end_s - shortest_s, low_s)
    for one, other in zip(first.signals, second.signals, strict=True):
        (t_s, values), (other_t_s, other_values) = (
            _between(each, begin_s - shift_s, end_s - shift_s)
            for each, shift_s in ((one, 0.0), (other, ahead_s))
        )
        if len(t_s) != len(other_t_s) or not np.allclose(
            t_s, other_t_s + ahead_s, rtol=0.0, atol=_TIME_TOLERANCE_S
        ):
            return None
        size = float(np.max(np.abs(one.values)))
        if not np.allclose(values, other_values, _VALUE_TOLERANCE, _VALUE_TOLERANCE * size):
            return None
    return begin_s, begin_s - ahead_s


def _extent(drive: LoggedDrive) -> tuple[float, float]:
    return (
        max(float(each.t_s[0]) for each in drive.signals),
        min(float(each.t_s[-1]) for each in drive.signals),
    )


def _between(signal: LogSignal, begin_s: float, end_s: float) -> tuple[Array, Array]:
    edges = (begin_s - _TIME_TOLERANCE_S, end_s + _TIME_TOLERANCE_S)
    low, high = np.searchsorted(signal.t_s, edges)
    return signal.t_s[low:high], signal.values[low:high]
