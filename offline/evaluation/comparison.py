"""Models compared with baselines on all test sets; tables, plots and JSON are made from it."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from offline.evaluation.metrics import (
    SHARES,
    Ratio,
    Scores,
    StateUnit,
    TrajectoryErrors,
    geometric_mean,
    ratio_of,
    score,
    state_units,
)
from offline.evaluation.predictor import Predictor
from offline.evaluation.series import Series, Slice
from offline.evaluation.test_sets import LIBRARY, TestSet
from rt_controller.contract.signals import Schema

FAIR_LTI = "fair lti"
"""for each state the better of `LTI_BASELINES`"""

LTI_BASELINES = ("lti", "lti-per-curvature")

LINEAR = "linear"
"""class of the baselines whose best one is named for each set and slice"""

ErrorsByName = Mapping[str, TrajectoryErrors]
"""of models and baselines on the same trajectories"""


@dataclass(frozen=True, slots=True)
class Comparison:
    """Scores of models and baselines on the same test sets."""

    columns: tuple[StateUnit, ...]
    dt_s: float
    models: tuple[str, ...]
    """names of the evaluated models"""
    baselines: tuple[str, ...]
    classes: Mapping[str, str]
    """of the baselines that have one, as `Baseline.model_class`"""
    not_converged: tuple[str, ...]
    """baselines whose training ended before their validation error was flat"""
    sets: tuple[TestSet, ...]
    """the library first"""
    scores: Mapping[str, Mapping[str, Scores]]
    """by name of the set, then of the model or baseline"""
    series: tuple[Series, ...]

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

    def errors_on(self, name: str) -> dict[str, TrajectoryErrors]:
        """Errors by model and baseline on a whole test set."""
        return {model: scores.by_trajectory for model, scores in self.scores[name].items()}

    def errors_in(self, part: Slice) -> dict[str, TrajectoryErrors]:
        """Errors by model and baseline on a slice of a test set."""
        return {name: each.take(part.rows) for name, each in self.errors_on(part.of).items()}

    def size_of(self, part: Slice) -> tuple[int, int]:
        """Numbers of trajectories and of episodes in a slice."""
        episode = next(iter(self.errors_in(part).values())).episode
        return len(episode), len(np.unique(episode))

    def ratios(self, model: str, errors: ErrorsByName) -> dict[str, Ratio]:
        """By baseline: its mean errors over those of the model, so above 1 the model is better."""
        own = errors[model].mean_draws
        return {
            name: ratio_of(errors[name].mean_draws, own, self.columns) for name in self.baselines
        }

    def ratios_to_baselines(self, model: str, on: str = LIBRARY) -> dict[str, Ratio]:
        """`ratios` on a whole test set, and first that of the fair LTI if there are both of its.

        The better linear model of a state is chosen anew in every draw.
        """
        errors = self.errors_on(on)
        linear = [errors[name].mean_draws for name in LTI_BASELINES if name in self.baselines]
        found = self.ratios(model, errors)
        if len(linear) < len(LTI_BASELINES):
            return found
        fair = ratio_of(np.min(linear, axis=0), errors[model].mean_draws, self.columns)
        return {FAIR_LTI: fair, **found}

    def ratios_of_quantiles(self, model: str) -> dict[float, dict[str, Ratio]]:
        """By share of `SHARES` and baseline: quantiles of its errors over those of the model."""
        draws = {name: errors.quantile_draws for name, errors in self.errors_on(LIBRARY).items()}
        return {
            share: {
                name: ratio_of(draws[name][:, s], draws[model][:, s], self.columns)
                for name in self.baselines
            }
            for s, share in enumerate(SHARES)
        }

    def growth(self, name: str, errors: TrajectoryErrors) -> Ratio:
        """Mean errors of a model or baseline over its own on the library."""
        own = self.library[name].by_trajectory.mean_draws
        return ratio_of(errors.mean_draws, own, self.columns)

    def ratio_to_library(self, name: str, on: str) -> Ratio:
        """Errors of a model or baseline on another set over its own on the library."""
        return self.growth(name, self.scores[on][name].by_trajectory)

    def best_linear(self, errors: ErrorsByName) -> str | None:
        """The linear baseline with the smallest geometric mean over the states of its mean errors.

        None if there is none.
        """
        return min(
            (name for name in self.baselines if self.classes.get(name) == LINEAR),
            key=lambda name: float(geometric_mean(errors[name].mean_draws[0])),
            default=None,
        )


def compare_models(
    models: Mapping[str, Predictor],
    baselines: Mapping[str, Predictor],
    sets: Sequence[TestSet],
    schema: Schema,
    *,
    classes: Mapping[str, str] | None = None,
    not_converged: Collection[str] = (),
    series: Sequence[Series] = (),
    on_progress: Callable[[str, str], None] = lambda model, test: None,
) -> Comparison:
    """Every model and baseline evaluated on every set.

    Args:
        models: the evaluated models by name.
        baselines: what they are compared with.
        sets: the test sets, the library first.
        schema: of their signals.
        classes: class of baselines by name, as `Baseline.model_class`.
        not_converged: as in `Comparison`.
        series: slices of these sets.
        on_progress: called with the name of the model and of the set before each evaluation.
    """
    columns = state_units(schema)
    scores: dict[str, dict[str, Scores]] = {test.name: {} for test in sets}
    for test in sets:
        for name, model in {**models, **baselines}.items():
            on_progress(name, test.name)
            scores[test.name][name] = score(model, test, columns)

    return Comparison(
        columns=columns,
        dt_s=schema.dt_s,
        models=tuple(models),
        baselines=tuple(baselines),
        classes=dict(classes or {}),
        not_converged=tuple(not_converged),
        sets=tuple(sets),
        scores=scores,
        series=tuple(series),
    )
