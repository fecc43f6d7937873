"""Models compared with baselines on all test sets.

Every number is computed once, into the tree that `--json` writes; tables, the page and its plots
are made from it.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from offline.evaluation.bootstrap import CONFIDENCE, RESAMPLES, SEED, estimate, mean_draws
from offline.evaluation.metrics import (
    Figures,
    StateUnit,
    TrajectoryErrors,
    by_key,
    errors_on,
    geometric_mean,
    ratios_of,
    state_units,
)
from offline.evaluation.predictor import Predictor
from offline.evaluation.series import Series
from offline.evaluation.test_sets import LIBRARY, TestSet
from rt_controller.contract.arrays import Array
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
    """Errors of models and baselines on the same test sets."""

    columns: tuple[StateUnit, ...]
    dt_s: float
    steps: int
    """K, the length of the horizon"""
    models: tuple[str, ...]
    """names of the evaluated models"""
    baselines: tuple[str, ...]
    not_converged: tuple[str, ...]
    """baselines whose training ended before their validation error was flat"""
    sets: tuple[TestSet, ...]
    """the library first"""
    figures: Figures
    """all results, as `--json` has them"""

    @property
    def names(self) -> tuple[str, ...]:
        """All models, then all baselines."""
        return self.models + self.baselines

    @property
    def library(self) -> Figures:
        """Results on the library, the reference of the other sets."""
        found: Figures = self.figures["sets"][LIBRARY]
        return found


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
    columns, steps, classes = state_units(schema), 0, dict(classes or {})
    errors: dict[str, dict[str, TrajectoryErrors]] = {test.name: {} for test in sets}
    details: Figures = {}
    for test in sets:
        for name, model in {**models, **baselines}.items():
            on_progress(name, test.name)
            by_step, errors[test.name][name] = errors_on(model, test, columns)
            if test.name == LIBRARY:
                steps = by_step.shape[1]
                details[name] = _of_steps(by_step, test, columns)
    linear = [name for name in baselines if classes.get(name) == LINEAR]
    tree = _Tree(columns, tuple(models), tuple(baselines), linear, errors)
    figures = {
        "models": list(models),
        "baselines": list(baselines),
        "class_of_baseline": classes,
        "not_converged": list(not_converged),
        "dt_s": schema.dt_s,
        "bootstrap": {
            "by": "episode",
            "resamples": RESAMPLES,
            "confidence": CONFIDENCE,
            "seed": SEED,
        },
        "sets": {test.name: tree.of_set(test, details) for test in sets},
        "series": {
            each.name: {
                "quantity": each.quantity,
                "unit": each.unit,
                "description": each.on,
                "slices": [
                    {"label": part.label, "set": part.of}
                    | tree.of_slice(
                        {name: one.take(part.rows) for name, one in errors[part.of].items()}
                    )
                    for part in each.slices
                ],
            }
            for each in series
        },
    }
    return Comparison(
        columns,
        schema.dt_s,
        steps,
        tuple(models),
        tuple(baselines),
        tuple(not_converged),
        tuple(sets),
        figures,
    )


def library_figures(comparison: Comparison) -> Figures:
    """The MSE table over all roads of the library."""
    library = comparison.library
    models = {name: {"mse": found["mse"]} for name, found in library["models"].items()}
    return {**{key: library[key] for key in ("n_trajectories", "n_episodes")}, "models": models}


def _of_steps(errors: Array, test: TestSet, columns: Sequence[StateUnit]) -> Figures:
    """RMS of the absolute errors (N, K, n) of each step."""
    with np.errstate(over="ignore"):
        rms = estimate(np.sqrt(mean_draws(np.square(errors), test.trajectories.episode)))
    return {
        "rms": {
            column.key: {part: values[:, i].tolist() for part, values in rms._asdict().items()}
            for i, column in enumerate(columns)
        }
    }


@dataclass(frozen=True, slots=True)
class _Tree:
    """Figures of sets and slices from the errors of all models."""

    columns: tuple[StateUnit, ...]
    models: tuple[str, ...]
    baselines: tuple[str, ...]
    linear: Sequence[str]
    errors: Mapping[str, ErrorsByName]

    def of_set(self, test: TestSet, by_step: Figures) -> Figures:
        """`by_step`, by model, is that of the library."""
        errors, found = self.errors[test.name], dict[str, Figures]()
        for name, each in errors.items():
            rms = estimate(np.sqrt(each.mean_draws))
            found[name] = {
                "mse": self._mse(each.mean_draws),
                "rms": by_key(rms, [column.key for column in self.columns]),
                "mse_by_curvature_per_m": {
                    f"{kappa:g}": self._mse(each.take(test.is_on_road(kappa)).mean_draws)
                    for kappa in test.curvatures_per_m
                },
                "trajectories_without_finite_prediction": each.diverged,
            }
        figures = {
            "description": test.description,
            "data_sha256": test.data_sha256,
            "n_trajectories": test.n_trajectories,
            "n_episodes": test.n_episodes,
            "models": found,
            "best_baseline": self._best(errors),
            "baseline_mse_over_model_mse": {
                model: self._fair(errors, model) | self._ratios(errors, model)
                for model in self.models
            },
        }
        if test.name == LIBRARY:
            return {**figures, "by_step": by_step}
        return {**figures, "mse_over_library_mse": self._growth(errors)}

    def of_slice(self, errors: ErrorsByName) -> Figures:
        episode = next(iter(errors.values())).episode
        ratios = {model: self._ratios(errors, model) for model in self.models}
        states = [column.name for column in self.columns]
        return {
            "n_trajectories": len(episode),
            "n_episodes": len(np.unique(episode)),
            "best_baseline": self._best(errors),
            "baseline_mse_over_model_mse": ratios,
            "state_of_smallest_ratio": {
                model: {
                    name: min(states, key=lambda s: np.nan_to_num(each[s]["value"], nan=np.inf))
                    for name, each in by_name.items()
                }
                for model, by_name in ratios.items()
            },
            "mse": {name: self._mse(each.mean_draws) for name, each in errors.items()},
            "mse_over_library_mse": self._growth(errors),
        }

    def _mse(self, draws: Array) -> Figures:
        return by_key(estimate(draws), [column.squared_key for column in self.columns])

    def _ratios(self, errors: ErrorsByName, model: str) -> Figures:
        """By baseline: its mean errors over those of the model, so above 1 the model is better."""
        own = errors[model].mean_draws
        return {
            name: ratios_of(errors[name].mean_draws, own, self.columns) for name in self.baselines
        }

    def _fair(self, errors: ErrorsByName, model: str) -> Figures:
        """The same of the better linear model of each state, chosen anew in every draw."""
        if not set(LTI_BASELINES) <= set(self.baselines):
            return {}
        fair = np.min([errors[name].mean_draws for name in LTI_BASELINES], axis=0)
        return {FAIR_LTI: ratios_of(fair, errors[model].mean_draws, self.columns)}

    def _growth(self, errors: ErrorsByName) -> Figures:
        """By model or baseline: its mean errors over its own on the library."""
        library = self.errors[LIBRARY]
        return {
            name: ratios_of(each.mean_draws, library[name].mean_draws, self.columns)
            for name, each in errors.items()
        }

    def _best(self, errors: ErrorsByName) -> dict[str, str]:
        """The linear baseline with the smallest geometric mean of its mean errors, if any."""
        if not self.linear:
            return {}
        best = min(
            self.linear,
            key=lambda name: float(geometric_mean(errors[name].mean_draws[0])),
        )
        return {LINEAR: best}
