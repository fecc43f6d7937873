"""Times in which a signal was not recorded, of each log."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from offline.logs.finding import Finding
from offline.logs.series import Drive, Series


class Gaps(NamedTuple):
    """The gaps of the signal of a log that misses most."""

    file: str
    number: int
    missing_s: float
    """all of them together"""
    first: str
    """signal and row after the first of them, or ''"""


def find_gaps(drive: Drive) -> Gaps:
    """The gaps of one log: where two samples are farther apart than the mapping bridges."""
    worst = max(drive.all_series, key=_missing_s)
    if not worst.gaps:
        return Gaps(drive.path.name, 0, 0.0, "")
    first = f"{worst.name}, {drive.row_word} {worst.row[worst.gaps[0] + 1]}"
    return Gaps(drive.path.name, len(worst.gaps), _missing_s(worst), first)


def remarks(found: Sequence[Gaps]) -> list[Finding]:
    """One finding for each log with gaps."""
    return [
        Finding(
            "gaps",
            each.file,
            f"{each.number} without samples, {each.missing_s:.3g} s in all, the first before "
            f"{each.first}: the drive is cut there. longest_gap_s of [time] or of the signal "
            f"bridges longer ones, by straight lines",
        )
        for each in found
        if each.number
    ]


def _missing_s(series: Series) -> float:
    return float(np.diff(series.t_s)[list(series.gaps)].sum())
