"""How far an average over episodes can be trusted: the bootstrap, by whole episodes.

Slices of one drive share their speed, road and driver, so they say less than as many slices of
different drives. What is drawn anew, with replacement, is therefore the episode with all that was
cut from it. Every model is averaged under the same draws, and so is every ratio of two.
Efron and Tibshirani, An Introduction to the Bootstrap (1993), chapters 6 and 13.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RESAMPLES = 2_000
CONFIDENCE = 0.95
SEED = 46


class EpisodeSums(NamedTuple):
    """Numbers added up within each of E episodes."""

    total: Array
    """(E, ...)"""
    summands: Array
    """(E,) how many"""


class Estimate(NamedTuple):
    """A figure and the interval around it; arrays of one shape, or numbers."""

    value: Array
    low: Array
    """not a number where one episode is all there is"""
    high: Array

    def at(self, *index: int) -> "Estimate":
        """One entry of it."""
        return Estimate(*(np.asarray(part[index]) for part in self))


def sum_by_episode(values: Array, episode: NDArray[np.integer]) -> EpisodeSums:
    """Values (N, ...) added up within each episode, in the order of the episodes' numbers."""
    order = np.argsort(episode, kind="stable")
    _, first, count = np.unique(episode[order], return_index=True, return_counts=True)
    with np.errstate(over="ignore", invalid="ignore"):
        total = np.add.reduceat(values[order], first, axis=0)
    return EpisodeSums(total, count.astype(np.float64))


def mean_draws(sums: EpisodeSums) -> Array:
    """Means (1 + R, ...): of the episodes as they are, then of each resample of them.

    Any figure that follows from means follows from these, row by row, with its interval. A mean
    is infinite in every row where one of its numbers is not finite.
    """
    weights = _weights(len(sums.summands))
    flat = sums.total.reshape(len(sums.summands), -1)
    finite = np.isfinite(flat)
    means = weights @ np.where(finite, flat, 0.0) / (weights @ sums.summands)[:, None]
    means[:, ~finite.all(axis=0)] = np.inf
    return means.reshape(len(weights), *sums.total.shape[1:])


def estimate(draws: Array) -> Estimate:
    """Figure and percentile interval of draws (1 + R, ...), the first of them the sample itself."""
    tail = (1.0 - CONFIDENCE) / 2.0
    if len(draws) == 1:
        nothing = np.full(draws.shape[1:], np.nan)
        return Estimate(draws[0], nothing, nothing)
    with np.errstate(invalid="ignore"):
        low, high = np.quantile(draws[1:], [tail, 1.0 - tail], axis=0)
    return Estimate(draws[0], low, high)


def quantile_draws(values: Array, episode: NDArray[np.integer], shares: tuple[float, ...]) -> Array:
    """Quantiles (1 + R, S, ...) of values (N, ...): the least number that a share stays below.

    Of the values as they are, then of each resample of their episodes.
    """
    _, member = np.unique(episode, return_inverse=True)
    weights = _weights(int(member.max()) + 1)
    flat = values.reshape(len(values), -1)
    found = np.empty((len(weights), len(shares), flat.shape[1]))
    for column in range(flat.shape[1]):
        order = np.argsort(flat[:, column])
        found[:, :, column] = flat[order[_ranks(weights, member[order], shares)], column]
    return found.reshape(len(weights), len(shares), *values.shape[1:])


def _ranks(
    weights: Array, member: NDArray[np.integer], shares: tuple[float, ...]
) -> NDArray[np.int64]:
    """Ranks (1 + R, S) of the quantiles, among sorted values of the episodes `member` (N,).

    Counted first in blocks of them, by one matrix product, then within the block that matters:
    thousands of resamples of thousands of values would take seconds to add up one by one.
    """
    episodes, length = weights.shape[1], int(np.ceil(np.sqrt(len(member))))
    blocks = np.arange(len(member)) // length
    members_of_block = np.zeros((episodes, blocks[-1] + 1))
    np.add.at(members_of_block, (member, blocks), 1.0)
    upto = np.cumsum(weights @ members_of_block, axis=1)
    before = np.hstack([np.zeros((len(weights), 1)), upto])
    # What lies behind the last value belongs to an episode that is never drawn.
    padded = np.pad(member, (0, len(before[0]) * length - len(member)), constant_values=episodes)
    drawn = np.hstack([weights, np.zeros((len(weights), 1))])
    rows = np.arange(len(weights))
    ranks = np.empty((len(weights), len(shares)), dtype=np.int64)
    for i, share in enumerate(shares):
        # A count is whole: the hair keeps 0.9 * 10 from asking for the tenth of ten.
        wanted = np.ceil(share * upto[:, -1] - 1e-9)
        block = np.count_nonzero(upto < wanted[:, None], axis=1)
        inside = padded[block[:, None] * length + np.arange(length)]
        counted = before[rows, block][:, None] + np.cumsum(drawn[rows[:, None], inside], axis=1)
        ranks[:, i] = block * length + np.count_nonzero(counted < wanted[:, None], axis=1)
    return ranks


@lru_cache(maxsize=8)
def _weights(episodes: int) -> Array:
    """How often each episode counts (1 + R, E): once each, then as drawn with replacement.

    A single episode cannot be resampled: no draws follow the first row.
    """
    rng = np.random.default_rng([SEED, episodes])
    resamples = RESAMPLES if episodes > 1 else 0
    drawn = rng.multinomial(episodes, np.full(episodes, 1.0 / episodes), size=resamples)
    weights = np.vstack([np.ones((1, episodes)), drawn])
    weights.setflags(write=False)
    return weights
