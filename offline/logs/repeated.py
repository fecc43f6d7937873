"""Logs that have the same samples: a test on them would be one on the training data.

File names, formats and times of the clock do not matter; values and steps of time do.
"""

from collections.abc import Iterator, Sequence
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from offline.logs.episode import LEAST_SAMPLES
from offline.logs.signal import LoggedDrive, LogSignal
from rt_controller.contract.arrays import Array

_CHANGES = 24
"""of a signal, from which on two drives are compared"""
_TIME_TOLERANCE_S, _VALUE_TOLERANCE = 1e-3, 1e-5
"""for numbers that were written with other digits; the second is relative"""


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
        for pair, places_s in _common_changes(same):
            if pair in found or copies & set(pair):
                continue
            one, other = (drives[k] for k in pair)
            begins_s = _common_stretch(one, other, places_s, shortest_s)
            if begins_s is not None:
                places = f"{begins_s[1]:.4g} s on, there {begins_s[0]:.4g} s on"
                found[pair] = f"among others from {places}"
    return [
        f"{drives[k].signals[0].column.path} has the same samples as {drives[first].name}, "
        f"{where}: a test on one of them is a test on training data. Leave one out, or the part "
        f"that they share; if they are different drives, write accept_repeated = true in [checks]."
        for (first, k), where in found.items()
    ]


def _common_changes(
    same: Sequence[LogSignal],
) -> Iterator[tuple[tuple[int, int], tuple[float, float]]]:
    """Numbers of two drives in which a signal changes equally, and the begin of that in each."""
    known: dict[bytes, tuple[int, float, float]] = {}
    for k, signal in enumerate(same):
        codes, t_s = _changes(signal)
        places = range(len(codes) - _CHANGES)
        blocks = [codes[i : i + _CHANGES].tobytes() for i in places]
        spans_s = t_s[_CHANGES:] - t_s[:-_CHANGES]
        for i in places:
            if blocks[i] in known:
                other, begin_s, span_s = known[blocks[i]]
                if abs(spans_s[i] - span_s) <= 2.0 * _TIME_TOLERANCE_S:
                    yield (other, k), (begin_s, float(t_s[i]))
        for i in places[::_CHANGES]:
            known.setdefault(blocks[i], (k, float(t_s[i]), float(spans_s[i])))


def _changes(signal: LogSignal) -> tuple[NDArray[np.uint32], Array]:
    """The values of a signal where it changes, rounded, and their times."""
    rounded = signal.values.astype(np.float32) + np.float32(0.0)  # no negative zero
    codes = (rounded.view(np.uint32).astype(np.uint64) + 8 >> 4).astype(np.uint32)
    is_new = np.diff(codes, prepend=codes[:1] + np.uint32(1)) != 0
    return codes[is_new], signal.t_s[is_new]


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
