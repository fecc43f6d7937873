"""Mean squared error of each trajectory, from which means, medians and tails are computed."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from offline.data.trajectories import Rows
from offline.evaluation.bootstrap import (
    Estimate,
    estimate,
    mean_draws,
    quantile_draws,
    sum_by_episode,
    tail_draws,
)
from rt_controller.contract.arrays import Array

SHARES = (0.5, 0.9, 0.99)
"""quantiles over the trajectories"""

WORST_SHARE = 0.01
"""of the trajectories: those with the largest errors"""


@dataclass(frozen=True)
class TrajectoryErrors:
    """Squared errors of N trajectories, averaged over the steps; n states in squared units.

    The draws are those of `offline.evaluation.bootstrap`: the sample, then R resamples.
    """

    mse: Array
    """(N, n); infinite where a prediction is not finite"""
    episode: NDArray[np.int32]
    """(N,)"""

    def take(self, rows: Rows) -> "TrajectoryErrors":
        """The errors of these trajectories."""
        return TrajectoryErrors(self.mse[rows], self.episode[rows])

    @cached_property
    def mean_draws(self) -> Array:
        """Means (1 + R, n) over the trajectories."""
        return mean_draws(sum_by_episode(self.mse, self.episode))

    @cached_property
    def quantile_draws(self) -> Array:
        """Quantiles (1 + R, S, n) over the trajectories, S as `SHARES`."""
        return quantile_draws(self.mse, self.episode, SHARES)

    def mean(self) -> Estimate:
        """Mean squared error (n,) over steps and trajectories. Paper: Table I."""
        return estimate(self.mean_draws)

    def quantiles(self) -> Estimate:
        """Quantiles (S, n) over the trajectories."""
        return estimate(self.quantile_draws)

    @cached_property
    def worst_part(self) -> Estimate:
        """Part (n,) of the sum of squared errors that the worst trajectories have.

        NaN if the sum is not finite.
        """
        return estimate(tail_draws(self.mse, self.episode, WORST_SHARE))
