"""How many times slower one is than another, within a round, over several rounds."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rt_controller.contract.bundle import Array


class Ratio(NamedTuple):
    """To somebody else in the same round: the median of the rounds, and the least and most."""

    median: float
    least: float
    most: float

    def __str__(self) -> str:
        return f"{self.median:.2f} ({self.least:.2f}–{self.most:.2f})"


def ratio_of(mine: Sequence[float], others: Sequence[float]) -> Ratio:
    """Of two figures a round."""
    ratios = [a / b for a, b in zip(mine, others, strict=True)]
    return Ratio(float(np.median(ratios)), min(ratios), max(ratios))


def p50(times: Array | Sequence[float]) -> float:
    """The median."""
    return float(np.median(times))


def p99(times: Array | Sequence[float]) -> float:
    """The 99th percentile, as a time that was measured."""
    return float(np.percentile(times, 99.0, method="higher"))
