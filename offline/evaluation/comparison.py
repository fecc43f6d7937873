"""Models compared with baselines on all test sets; tables, plots and JSON are made from it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from offline.evaluation.metrics import Scores, score
from offline.evaluation.predictor import Predictor
from offline.evaluation.ratio import Ratio, geometric_mean, ratio_of
from offline.evaluation.series import Series
from offline.evaluation.state_units import StateUnit, state_units
from offline.evaluation.test_sets import LIBRARY, TestSet
from offline.evaluation.trajectory_errors import SHARES, TrajectoryErrors
from rt_controller.contract.schema import Schema

FAIR_LTI = "fair lti"
"""for each state the better of `LTI_BASELINES`"""

LTI_BASELINES = ("lti", "lti-per-curvature")

LINEAR, RECURRENT = "linear", "recurrent"
CLASSES = (LINEAR, RECURRENT)
"""classes of baselines whose best one is named for each set and slice"""


class ScoredSlice(NamedTuple):
    """Errors of all models and baselines on one slice of a test set."""

    label: str
    of: str
    """name of the test set"""
    errors: Mapping[str, TrajectoryErrors]
    """by model or baseline"""

    @property
    def n_trajectories(self) -> int:
        return len(next(iter(self.errors.values())).episode)

    @property
    def n_episodes(self) -> int:
        return len(np.unique(next(iter(self.errors.values())).episode))


class ScoredSeries(NamedTuple):
    """A series with the errors on its slices."""

    series: Series
    slices: tuple[ScoredSlice, ...]


@dataclass(frozen=True, slots=True)
class Comparison:
    """Scores of models and baselines on the same test sets."""

    columns: tuple[StateUnit, ...]
    dt_s: float
    models: tuple[str, ...]
    """names of the evaluated models"""
    baselines: tuple[str, ...]
    classes: Mapping[str, str]
    """class of each baseline that has one of `CLASSES`"""
    sets: tuple[TestSet, ...]
    """the library first"""
    scores: Mapping[str, Mapping[str, Scores]]
    """by name of the set, then of the model or baseline"""
    series: tuple[ScoredSeries, ...]

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

    def ratios_to_baselines(self, model: str, on: str = LIBRARY) -> dict[str, Ratio]:
        """By baseline: its mean errors over those of the model, so above 1 the model is better.

        The fair LTI comes first if there are both linear models; it is chosen anew in every draw.
        """
        errors = self.errors_on(on)
        draws = {name: errors[name].mean_draws for name in self.baselines}
        linear = [draws[name] for name in LTI_BASELINES if name in draws]
        if len(linear) > 1:
            draws = {FAIR_LTI: np.min(linear, axis=0), **draws}
        own = errors[model].mean_draws
        return {name: ratio_of(above, own, self.columns) for name, above in draws.items()}

    def ratios_of_quantiles(self, model: str, on: str = LIBRARY) -> dict[float, dict[str, Ratio]]:
        """By share of `SHARES` and baseline: quantiles of its errors over those of the model."""
        errors = self.errors_on(on)
        return {
            share: {
                name: ratio_of(
                    errors[name].quantile_draws[:, s], errors[model].quantile_draws[:, s],
                    self.columns,
                )
                for name in self.baselines
            }
            for s, share in enumerate(SHARES)
        }  # fmt: skip

    def ratio_to_library(self, model: str, on: str) -> Ratio:
        """Errors of the model on another set over its errors on the library."""
        return self.growth(model, self.scores[on][model].by_trajectory)

    def growth(self, model: str, errors: TrajectoryErrors) -> Ratio:
        """Mean errors of the model over those on the library."""
        own = self.library[model].by_trajectory.mean_draws
        return ratio_of(errors.mean_draws, own, self.columns)

    def ratio_to(self, model: str, baseline: str, errors: Mapping[str, TrajectoryErrors]) -> Ratio:
        """Mean errors of a baseline over those of the model, given the errors by name."""
        return ratio_of(errors[baseline].mean_draws, errors[model].mean_draws, self.columns)

    @property
    def known_classes(self) -> tuple[str, ...]:
        """Those of `CLASSES` that one of the baselines has."""
        return tuple(each for each in CLASSES if each in self.classes.values())

    def best_baselines(self, errors: Mapping[str, TrajectoryErrors]) -> dict[str, str]:
        """By class of `CLASSES`: the baseline with the smallest geometric mean of its mean errors.

        A class without a baseline is left out.
        """
        return {
            each: min(
                (name for name in self.baselines if self.classes.get(name) == each),
                key=lambda name: _pooled(errors[name]),
            )
            for each in self.known_classes
        }


def compare_models(
    models: Mapping[str, Predictor],
    baselines: Mapping[str, Predictor],
    sets: Sequence[TestSet],
    schema: Schema,
    *,
    classes: Mapping[str, str] | None = None,
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
        classes={
            name: found
            for name, found in (classes or {}).items()
            if name in baselines and found in CLASSES
        },
        sets=tuple(sets),
        scores=scores,
        series=tuple(_score_slices(each, scores) for each in series),
    )


def _score_slices(series: Series, scores: Mapping[str, Mapping[str, Scores]]) -> ScoredSeries:
    slices = (
        ScoredSlice(
            part.label,
            part.of,
            {name: each.by_trajectory.take(part.rows) for name, each in scores[part.of].items()},
        )
        for part in series.slices
    )
    return ScoredSeries(series, tuple(slices))


def _pooled(errors: TrajectoryErrors) -> float:
    """Geometric mean over the states of the mean errors."""
    return float(geometric_mean(errors.mean_draws[0]))
