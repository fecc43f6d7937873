"""How many times smaller one model's errors are than another's.

A ratio is one of mean squared errors, the rival's over the model's: above 1 the model is better.
Its interval comes from the same draws of episodes for both, so what a hard episode does to both
cancels.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offline.bootstrap import Estimate, estimate
from offline.evaluate import Scores, mse_draws

Array = NDArray[np.float64]


class Ratio(NamedTuple):
    """Mean squared errors of one over those of another."""

    by_state: Estimate
    """(n,)"""
    geometric_mean: Estimate
    """(), over the states"""


def ratio(above: Array, below: Array) -> Ratio:
    """Of two sets of draws (1 + R, n) of the same episodes, as `evaluate.mse_draws` makes them."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = above / below
        geometric = np.exp(np.log(ratios).mean(axis=-1))
    return Ratio(estimate(ratios), estimate(geometric))


def best_of(rivals: Sequence[Scores]) -> Array:
    """Draws (1 + R, n) of a rival that is in each state as good as the best of these there."""
    return np.asarray(np.min([mse_draws(rival) for rival in rivals], axis=0))
