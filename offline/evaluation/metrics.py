"""Errors of two-second open-loop predictions, in the units of the paper's Table I.

The state is lifted once, at the first instant, and the errors of steps 1..K count; the first state
is measured and does not count. Squared errors are averaged over steps and trajectories.
Paper: section IV, Table I.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from offline.evaluation.bootstrap import (
    EpisodeSums,
    Estimate,
    estimate,
    mean_draws,
    quantile_draws,
    sum_by_episode,
)
from offline.evaluation.predictor import Predictor, prediction_errors
from offline.evaluation.state_units import StateUnit
from offline.evaluation.test_sets import TestSet
from offline.evaluation.trajectory_errors import SHARES, TrajectoryErrors
from rt_controller.contract.arrays import Array

MARKED_STEPS = (20, 40, 80)
"""steps at which quantiles get an interval; 20 is the controller's horizon"""


@dataclass(frozen=True, slots=True)
class Scores:
    """Errors of one model on one test set; n states in the units of Table I."""

    squared: EpisodeSums
    """(E, K, n) squared errors of each step"""
    by_trajectory: TrajectoryErrors
    quantiles: Array
    """(S, K, n) of the absolute error at each step, S as `SHARES`"""
    marked_steps: tuple[int, ...]
    """M, those of `MARKED_STEPS` within the horizon"""
    marked: NDArray[np.float32]
    """(N, M, n) absolute errors at the marked steps"""
    diverged: int
    """number of trajectories with a prediction that is not finite"""

    def mse(self) -> Estimate:
        """Mean squared error (n,) of each state. Paper: Table I."""
        return self.by_trajectory.mean()

    def rms(self) -> Estimate:
        """Root mean square error (n,)."""
        return estimate(np.sqrt(self.by_trajectory.mean_draws))

    def rms_by_step(self) -> Estimate:
        """Root mean square error (K, n) of each step."""
        return estimate(np.sqrt(mean_draws(self.squared)))

    def quantiles_at_marks(self) -> Estimate:
        """Quantiles (S, M, n) of the absolute error at the marked steps, S as `SHARES`."""
        marked, episode = self.marked.astype(np.float64), self.by_trajectory.episode
        return estimate(quantile_draws(marked, episode, SHARES))


def score(model: Predictor, test: TestSet, columns: tuple[StateUnit, ...]) -> Scores:
    """Errors of the model on the test set."""
    errors = prediction_errors(model, test.trajectories)
    with np.errstate(over="ignore"):
        errors *= [column.per_si for column in columns]
    episode = test.trajectories.episode
    marked = tuple(step for step in MARKED_STEPS if step <= errors.shape[1])
    magnitude = np.where(np.isnan(errors), np.inf, np.abs(errors))
    with np.errstate(over="ignore"):
        squared = np.square(errors)
        by_trajectory = np.square(magnitude).mean(axis=1)
        at_marks = magnitude[:, [step - 1 for step in marked]].astype(np.float32)
    return Scores(
        squared=sum_by_episode(squared, episode),
        by_trajectory=TrajectoryErrors(by_trajectory, episode),
        quantiles=np.quantile(magnitude, SHARES, axis=0, method="inverted_cdf"),
        marked_steps=marked,
        marked=at_marks,
        diverged=int(np.count_nonzero(~np.isfinite(errors).all(axis=(1, 2)))),
    )
