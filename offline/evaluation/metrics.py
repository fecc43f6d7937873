"""Errors of open-loop predictions over two seconds, in the units of Table I, and their ratios.

The state is lifted once, at the first instant, and the errors of steps 1..K count; the first state
is measured and does not count. Squared errors are averaged over steps and trajectories. Two errors
of a ratio have the same draws of episodes, so the difficulty of an episode cancels, and the
interval of a ratio is narrower than those of its two errors.
Paper: section IV, Table I.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offline.data.signals import Rows
from offline.evaluation.bootstrap import (
    EpisodeSums,
    Estimate,
    estimate,
    mean_draws,
    quantile_draws,
    sum_by_episode,
    tail_draws,
)
from offline.evaluation.predictor import Predictor, prediction_errors
from offline.evaluation.test_sets import TestSet
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import Schema

SHARES = (0.5, 0.9, 0.99)
"""quantiles over the trajectories"""

WORST_SHARE = 0.01
"""of the trajectories: those with the largest errors"""

MARKED_STEPS = (20, 40, 80)
"""steps at which quantiles get an interval; 20 is the controller's horizon"""

LARGEST_RATIO_ON_NEW_ROADS = 1.5
"""goal for every state: MSE on new roads over MSE on the roads of the library"""

PROGRESS = "ds"
"""progress per period: the speed once more (correlation 0.997 on the training data), so the
geometric mean over all states counts the speed twice"""

_TABLE_UNITS = {
    "m/s": ("km/h", 3.6),
    "rad/s": ("deg/s", float(np.degrees(1.0))),
    "rad": ("deg", float(np.degrees(1.0))),
}
"""by SI unit: unit in tables, and the factor to it; other units are not converted"""


class StateUnit(NamedTuple):
    """Name and unit of a state in tables."""

    name: str
    """without the unit"""
    unit: str
    per_si: float
    """value in `unit` = per_si * value in the state's own unit"""

    @property
    def key(self) -> str:
        """Name with unit for JSON: "vx_kmh"."""
        return "_".join(filter(None, (self.name, _suffix(self.unit))))

    @property
    def squared_key(self) -> str:
        """Key of a squared error: "vx_kmh_squared"."""
        return f"{self.key}_squared"

    @property
    def squared_unit(self) -> str:
        """Unit of a squared error as the paper prints it: "(km/h)^2", "m^2"."""
        if self.unit in ("", "1"):
            return "1"
        return f"{self.unit}^2" if self.unit.isalpha() else f"({self.unit})^2"


def state_units(schema: Schema) -> tuple[StateUnit, ...]:
    """The states of a schema, in their order."""
    units = []
    for state in schema.states:
        unit, factor = _TABLE_UNITS.get(state.unit, (state.unit, 1.0))
        name = state.name.removesuffix(f"_{_suffix(state.unit)}")
        units.append(StateUnit(name, unit, factor))
    return tuple(units)


def _suffix(unit: str) -> str:
    """A unit as the end of a name: "mps" of "m/s", "kmh" of "km/h", "per_m" of "1/m", "" of "1"."""
    if unit in ("", "1"):
        return ""
    if unit == "km/h":
        return "kmh"
    if unit.startswith("1/"):
        return "per_" + _suffix(unit.removeprefix("1/"))
    return re.sub(r"[^a-z0-9]", "", unit.lower().replace("/", "p"))


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


class Ratio(NamedTuple):
    """A ratio of errors."""

    by_state: Estimate
    """(n,)"""
    geometric_mean: Estimate
    """(), over the states"""
    without_progress: Estimate | None
    """(), over the states but `PROGRESS`; None if there is no such state"""

    @property
    def means(self) -> tuple[Estimate, ...]:
        """The geometric means that there are."""
        return tuple(mean for mean in self[1:] if mean is not None)

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
