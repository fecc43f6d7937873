"""Bootstrap confidence intervals of averages over trajectories, resampled by whole episodes.

Trajectories cut from one episode share its speed, road and driver, so they are not independent.
Therefore whole episodes are drawn with replacement, each with all its trajectories. All models are
averaged under the same draws, and so are ratios of two models.
Efron and Tibshirani, An Introduction to the Bootstrap (1993), chapters 6 and 13.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array

RESAMPLES = 2_000
CONFIDENCE = 0.95
SEED = 46
Episodes = NDArray[np.integer]


class Estimate(NamedTuple):
    """A value and its confidence interval; arrays of one shape, or numbers."""

    value: Array
    low: Array
    """NaN if there is only one episode"""
    high: Array


def estimate(draws: Array) -> Estimate:
    """Value and percentile interval of draws (1 + R, ...), the first of which is the sample."""
    tail = (1.0 - CONFIDENCE) / 2.0
    if len(draws) == 1:
        no_interval = np.full(draws.shape[1:], np.nan)
        return Estimate(draws[0], no_interval, no_interval)
    with np.errstate(invalid="ignore"):
        low, high = np.quantile(draws[1:], [tail, 1.0 - tail], axis=0)
    return Estimate(draws[0], low, high)


def mean_draws(values: Array, episode: Episodes) -> Array:
    """Means (1 + R, ...) of values (N, ...): of the sample itself, then of each of R resamples.

    Any statistic of means is computed row by row from these, which gives its interval. A mean over
    a value that is not finite is infinite in every row.
    """
    order = np.argsort(episode, kind="stable")
    _, first, count = np.unique(episode[order], return_index=True, return_counts=True)
    with np.errstate(over="ignore", invalid="ignore"):
        total = np.add.reduceat(values[order], first, axis=0).reshape(len(first), -1)
    weights, finite = _weights(len(first)), np.isfinite(total)
    summands = weights @ count.astype(np.float64)
    means = weights @ np.where(finite, total, 0.0) / summands[:, None]
    means[:, ~finite.all(axis=0)] = np.inf
    return means.reshape(len(weights), *values.shape[1:])


@lru_cache(maxsize=8)
def _weights(episodes: int) -> Array:
    """How often each episode counts (1 + R, E): once in the first row, then as drawn.

    One episode alone cannot be resampled: there is only the first row.
    """
    rng = np.random.default_rng([SEED, episodes])
    resamples = RESAMPLES if episodes > 1 else 0
    drawn = rng.multinomial(episodes, np.full(episodes, 1.0 / episodes), size=resamples)
    weights = np.vstack([np.ones((1, episodes)), drawn])
    weights.setflags(write=False)
    return weights
