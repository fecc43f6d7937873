"""How well a model predicts two seconds ahead: what it gets wrong, in the units of Table I.

The lifted state is made once, at the first state, and the errors of the steps 1..K count; the
first state is measured and counts for nothing. Squares are averaged over steps and trajectories.
Paper: section IV, Table I.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from offline.bootstrap import (
    EpisodeSums,
    Estimate,
    estimate,
    mean_draws,
    quantile_draws,
    sum_by_episode,
)
from offline.predictor import Predictor
from offline.table_units import Column, per_si
from offline.test_sets import TestSet
from offline.trajectories import Trajectories

Array = NDArray[np.float64]

SHARES = (0.5, 0.9, 0.99)
"""quantiles of the absolute error: the usual one, a bad one, and nearly the worst"""

MARKED_STEPS = (20, 40, 80)
"""at which quantiles get an interval; 20 is the controller's horizon"""

_BATCH = 8_000
"""trajectories predicted at once: a matter of memory"""


@dataclass(frozen=True, slots=True)
class Marked:
    """Absolute errors at single steps."""

    steps: tuple[int, ...]
    errors: NDArray[np.float32]
    """(N, S, n)"""
    episode: NDArray[np.int32]
    """(N,)"""


@dataclass(frozen=True, slots=True)
class Scores:
    """What one model got wrong on one test set, n states in units of Table I."""

    squared: EpisodeSums
    """(E, K, n) squared errors of each step"""
    squared_on_road: Mapping[float, EpisodeSums]
    """by curvature in 1/m: (E, n) squared errors, averaged over the steps"""
    quantiles: Array
    """(S, K, n) of the absolute error at each step, S as `SHARES`"""
    marked: Marked
    diverged: int
    """trajectories on which a prediction is not finite"""


def score(model: Predictor, test: TestSet, columns: tuple[Column, ...]) -> Scores:
    """What the model gets wrong on the test set."""
    errors = prediction_errors(model, test.trajectories, columns)
    episode = test.trajectories.episode
    marked = tuple(step for step in MARKED_STEPS if step <= errors.shape[1])
    magnitude = np.where(np.isnan(errors), np.inf, np.abs(errors))
    with np.errstate(over="ignore"):
        squared = np.square(errors)
        at_marks = magnitude[:, [step - 1 for step in marked]].astype(np.float32)
    return Scores(
        squared=sum_by_episode(squared, episode),
        squared_on_road={
            kappa: sum_by_episode(squared[on_it].mean(axis=1), episode[on_it])
            for kappa in test.curvatures_per_m
            for on_it in [test.curvature_per_m == kappa]
        },
        quantiles=np.quantile(magnitude, SHARES, axis=0, method="inverted_cdf"),
        marked=Marked(marked, at_marks, episode),
        diverged=int(np.count_nonzero(~np.isfinite(errors).all(axis=(1, 2)))),
    )


def prediction_errors(
    model: Predictor, trajectories: Trajectories, columns: tuple[Column, ...]
) -> Array:
    """Errors (N, K, n) of the steps 1..K, predicted minus measured, in units of the table."""
    parts = []
    for first in range(0, len(trajectories.episode), _BATCH):
        part = trajectories.take(slice(first, first + _BATCH))
        x, u, w, past = (array.astype(np.float64) for array in part[:4])
        with np.errstate(over="ignore", invalid="ignore"):
            parts.append((model.predict(x[:, 0], past, u, w) - x)[:, 1:] * per_si(columns))
    return np.concatenate(parts)


def mse_draws(scores: Scores) -> Array:
    """Mean squared errors (1 + R, n) over steps and trajectories, under all draws of episodes."""
    return mean_draws(_over_steps(scores.squared))


def mse(scores: Scores) -> Estimate:
    """Mean squared error (n,) of each state. Paper: Table I."""
    return estimate(mse_draws(scores))


def rms(scores: Scores) -> Estimate:
    """Root of the mean squared error (n,)."""
    return estimate(np.sqrt(mse_draws(scores)))


def rms_by_step(scores: Scores) -> Estimate:
    """Root mean square (K, n) of the errors of each step."""
    return estimate(np.sqrt(mean_draws(scores.squared)))


def mse_on_road(scores: Scores, curvature_per_m: float) -> Estimate:
    """Mean squared error (n,) on the roads of one curvature."""
    return estimate(mean_draws(scores.squared_on_road[curvature_per_m]))


def quantiles_at_marks(scores: Scores) -> Estimate:
    """Quantiles (S, M, n) of the absolute error at `MARKED_STEPS`, S as `SHARES`."""
    marked = scores.marked
    return estimate(quantile_draws(marked.errors.astype(np.float64), marked.episode, SHARES))


def _over_steps(sums: EpisodeSums) -> EpisodeSums:
    with np.errstate(invalid="ignore"):
        return EpisodeSums(sums.total.mean(axis=1), sums.summands)
