"""Ratios of errors, by state and in the geometric mean.

A ratio is one error over another: a baseline's over a model's, or that on one test set over that on
another. Both have the same draws of episodes, so the difficulty of an episode cancels, and the
interval of a ratio is narrower than those of its two errors.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from offline.evaluation.bootstrap import Estimate, estimate
from offline.evaluation.state_units import StateUnit
from rt_controller.contract.arrays import Array

LARGEST_RATIO_ON_NEW_ROADS = 1.5
"""goal for every state: MSE on new roads over MSE on the roads of the library"""

PROGRESS = "ds"
"""progress per period: the speed once more (correlation 0.997 on the training data), so the
geometric mean over all states counts the speed twice"""


class Ratio(NamedTuple):
    """A ratio of errors."""

    by_state: Estimate
    """(n,)"""
    geometric_mean: Estimate
    """(), over the states"""
    without_progress: Estimate | None
    """(), over the states but `PROGRESS`; None if there is no such state"""

    @property
    def worst_state(self) -> int:
        """Index of the state with the largest ratio; NaN counts as infinite."""
        return int(np.argmax(np.nan_to_num(self.by_state.value, nan=np.inf)))

    @property
    def least_state(self) -> int:
        """Index of the state with the smallest ratio."""
        return int(np.argmin(np.nan_to_num(self.by_state.value, nan=np.inf)))

    @property
    def is_within_goal(self) -> bool:
        """True if no state exceeds the goal for new roads."""
        return bool(np.all(self.by_state.value <= LARGEST_RATIO_ON_NEW_ROADS))


def ratio_of(above: Array, below: Array, columns: Sequence[StateUnit]) -> Ratio:
    """Ratio of two errors, given their draws (1 + R, n).

    There is no interval if one of them has only the sample.
    """
    draws = min(len(above), len(below))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = above[:draws] / below[:draws]
    others = [i for i, column in enumerate(columns) if column.name != PROGRESS]
    has_progress = 0 < len(others) < len(columns)
    return Ratio(
        estimate(ratios),
        estimate(geometric_mean(ratios)),
        estimate(geometric_mean(ratios[:, others])) if has_progress else None,
    )


def geometric_mean(ratios: Array) -> Array:
    """Geometric mean over the last axis, the states; 0 if one of the ratios is 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.exp(np.log(ratios).mean(axis=-1)))
