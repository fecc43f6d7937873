"""Models compared with baselines on all test sets; tables, plots and JSON are made from it.

A ratio is one mean squared error over another: the baseline's over the model's, or that on one test
set over that on another. Both have the same draws of episodes, so the difficulty of an episode
cancels, and the interval of a ratio is narrower than those of its two errors.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from offline.evaluation.bootstrap import Estimate, estimate
from offline.evaluation.metrics import Scores, geometric_mean, score
from offline.evaluation.predictor import Predictor
from offline.evaluation.state_units import StateUnit, state_units
from offline.evaluation.test_sets import LIBRARY, TestSet
from rt_controller.contract.arrays import Array
from rt_controller.contract.schema import Schema

FAIR_LTI = "fair lti"
"""for each state the better of `LTI_BASELINES`"""

LTI_BASELINES = ("lti", "lti-per-curvature")

LARGEST_RATIO_ON_NEW_ROADS = 1.5
"""goal for every state: MSE on new roads over MSE on the roads of the library"""


class Ratio(NamedTuple):
    """A ratio of mean squared errors."""

    by_state: Estimate
    """(n,)"""
    geometric_mean: Estimate
    """(), over the states"""

    @property
    def worst_state(self) -> int:
        """Index of the state with the largest ratio; NaN counts as infinite."""
        return int(np.argmax(np.nan_to_num(self.by_state.value, nan=np.inf)))

    @property
    def is_within_goal(self) -> bool:
        """True if no state exceeds the goal for new roads."""
        return bool(np.all(self.by_state.value <= LARGEST_RATIO_ON_NEW_ROADS))


@dataclass(frozen=True, slots=True)
class Comparison:
    """Scores of models and baselines on the same test sets."""

    columns: tuple[StateUnit, ...]
    dt_s: float
    models: tuple[str, ...]
    """names of the evaluated models"""
    baselines: tuple[str, ...]
    sets: tuple[TestSet, ...]
    """the library first"""
    scores: Mapping[str, Mapping[str, Scores]]
    """by name of the set, then of the model or baseline"""

    @property
    def names(self) -> tuple[str, ...]:
        """All models, then all baselines."""
        return self.models + self.baselines

    @property
    def steps(self) -> int:
        """K, the length of the horizon."""
        return int(next(iter(self.library.values())).squared.total.shape[1])

    @property
    def library(self) -> Mapping[str, Scores]:
        """Scores by model on the library, the reference of the other sets."""
        return self.scores[LIBRARY]

    def find_set(self, name: str) -> TestSet | None:
        """The test set of that name; None if it is not part of the comparison."""
        return next((test for test in self.sets if test.name == name), None)

    def ratios_to_baselines(self, model: str, on: str = LIBRARY) -> dict[str, Ratio]:
        """By baseline: its errors over those of the model, so above 1 the model is better.

        The fair LTI comes first; it is chosen anew in every draw.
        """
        own = self.scores[on][model].mse_draws()
        draws = {name: self.scores[on][name].mse_draws() for name in self.baselines}
        linear = [draws[name] for name in LTI_BASELINES if name in draws]
        if linear:
            draws = {FAIR_LTI: np.min(linear, axis=0), **draws}
        return {name: _ratio(above, own) for name, above in draws.items()}

    def ratio_to_library(self, model: str, on: str) -> Ratio:
        """Errors of the model on another set over its errors on the library."""
        return _ratio(self.scores[on][model].mse_draws(), self.library[model].mse_draws())


def compare_models(
    models: Mapping[str, Predictor],
    baselines: Mapping[str, Predictor],
    sets: Sequence[TestSet],
    schema: Schema,
    on_progress: Callable[[str, str], None] = lambda model, test: None,
) -> Comparison:
    """Every model and baseline evaluated on every set.

    `on_progress` is called with the name of the model and of the set before each evaluation.
    """
    columns = state_units(schema)
    scores: dict[str, dict[str, Scores]] = {test.name: {} for test in sets}
    for test in sets:
        for name, model in {**models, **baselines}.items():
            on_progress(name, test.name)
            scores[test.name][name] = score(model, test, columns)
    return Comparison(columns, schema.dt_s, tuple(models), tuple(baselines), tuple(sets), scores)


def _ratio(above: Array, below: Array) -> Ratio:
    """Ratio of two sets of draws (1 + R, n) of the same episodes, as from `Scores.mse_draws`."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = above / below
    return Ratio(estimate(ratios), estimate(geometric_mean(ratios)))
