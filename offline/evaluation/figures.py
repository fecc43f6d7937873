"""Results of an evaluation as a tree for `--json`: all printed numbers, and those of each step."""

from typing import Any

from offline.evaluation.bootstrap import CONFIDENCE, RESAMPLES, SEED, Estimate
from offline.evaluation.comparison import Comparison, ScoredSeries, ScoredSlice
from offline.evaluation.metrics import Scores
from offline.evaluation.ratio import LARGEST_RATIO_ON_NEW_ROADS, PROGRESS, Ratio
from offline.evaluation.state_units import StateUnit
from offline.evaluation.test_sets import LIBRARY, NEW_ROADS, TestSet
from offline.evaluation.trajectory_errors import SHARES, WORST_SHARE, TrajectoryErrors

Figures = dict[str, Any]
Columns = tuple[StateUnit, ...]


def comparison_figures(comparison: Comparison) -> Figures:
    """All results; a value with an interval is {value, low, high}."""
    bootstrap = {"by": "episode", "resamples": RESAMPLES, "confidence": CONFIDENCE, "seed": SEED}
    return {
        "models": list(comparison.models),
        "baselines": list(comparison.baselines),
        "class_of_baseline": dict(comparison.classes),
        "dt_s": comparison.dt_s,
        "bootstrap": bootstrap,
        "sets": {test.name: _set_figures(comparison, test) for test in comparison.sets},
        "series": {
            each.series.name: _series_figures(comparison, each) for each in comparison.series
        },
    }


def library_figures(comparison: Comparison) -> Figures:
    """The MSE table over all roads of the library."""
    library = comparison.sets[0]
    return {
        "n_trajectories": library.n_trajectories,
        "n_episodes": library.n_episodes,
        "models": {
            name: {"mse": _squared(scores.mse(), comparison.columns)}
            for name, scores in comparison.library.items()
        },
    }


def _set_figures(comparison: Comparison, test: TestSet) -> Figures:
    columns, scores = comparison.columns, comparison.scores[test.name]
    figures: Figures = {
        "description": test.description,
        "data_sha256": test.data_sha256,
        "n_trajectories": test.n_trajectories,
        "n_episodes": test.n_episodes,
        "models": {name: _model_figures(scores[name], test, columns) for name in comparison.names},
        "best_baseline": comparison.best_baselines(comparison.errors_on(test.name)),
        "baseline_mse_over_model_mse": {
            model: _ratio_figures(comparison.ratios_to_baselines(model, test.name), columns)
            for model in comparison.models
        },
    }
    if test.name == LIBRARY:
        figures["worst_share"] = WORST_SHARE
        for name, errors in comparison.errors_on(test.name).items():
            figures["models"][name] |= _tail_figures(errors, columns)
        figures["baseline_mse_quantile_over_model_mse_quantile"] = {
            model: {
                _percent(share): _ratio_figures(ratios, columns)
                for share, ratios in comparison.ratios_of_quantiles(model).items()
            }
            for model in comparison.models
        }
        figures["absolute_error_quantiles"] = {
            model: _quantile_figures(scores[model], comparison) for model in comparison.models
        }
        figures["by_step"] = {
            name: _step_figures(scores[name], columns) for name in comparison.names
        }
        return figures
    ratios = {name: comparison.ratio_to_library(name, test.name) for name in comparison.names}
    figures["mse_over_library_mse"] = _ratio_figures(ratios, columns)
    if test.name == NEW_ROADS:
        figures["goal"] = LARGEST_RATIO_ON_NEW_ROADS
        figures["is_within_goal"] = {name: ratio.is_within_goal for name, ratio in ratios.items()}
    return figures


def _series_figures(comparison: Comparison, scored: ScoredSeries) -> Figures:
    """Slices as a list, in the order of their quantity."""
    series = scored.series
    return {
        "quantity": series.quantity,
        "unit": series.unit,
        "description": series.on,
        "slices": [_slice_figures(comparison, part) for part in scored.slices],
    }


def _slice_figures(comparison: Comparison, part: ScoredSlice) -> Figures:
    columns = comparison.columns
    ratios = {
        model: {
            name: comparison.ratio_to(model, name, part.errors) for name in comparison.baselines
        }
        for model in comparison.models
    }
    growth = {name: comparison.growth(name, part.errors[name]) for name in comparison.names}
    return {
        "label": part.label,
        "set": part.of,
        "n_trajectories": part.n_trajectories,
        "n_episodes": part.n_episodes,
        "best_baseline": comparison.best_baselines(part.errors),
        "mse": {name: _squared(each.mean(), columns) for name, each in part.errors.items()},
        "baseline_mse_over_model_mse": {
            model: _ratio_figures(to_baselines, columns) for model, to_baselines in ratios.items()
        },
        "state_of_smallest_ratio": {
            model: {name: columns[ratio.least_state].name for name, ratio in to_baselines.items()}
            for model, to_baselines in ratios.items()
        },
        "mse_over_library_mse": _ratio_figures(growth, columns),
    }


def _model_figures(scores: Scores, test: TestSet, columns: Columns) -> Figures:
    return {
        "mse": _squared(scores.mse(), columns),
        "rms": _by_state(scores.rms(), [column.key for column in columns]),
        "mse_by_curvature_per_m": {
            f"{kappa:g}": _squared(
                scores.by_trajectory.take(test.is_on_road(kappa)).mean(), columns
            )
            for kappa in test.curvatures_per_m
        },
        "trajectories_without_finite_prediction": scores.diverged,
    }


def _tail_figures(errors: TrajectoryErrors, columns: Columns) -> Figures:
    quantiles = errors.quantiles()
    return {
        "mse_quantiles_over_trajectories": {
            _percent(share): _by_state(quantiles.at(s), [each.squared_key for each in columns])
            for s, share in enumerate(SHARES)
        },
        "part_of_mse_of_worst_trajectories": _by_state(
            errors.worst_part, [each.name for each in columns]
        ),
    }


def _step_figures(scores: Scores, columns: Columns) -> Figures:
    """Lists with one number for each step."""
    by_step = scores.rms_by_step()._asdict()
    return {
        "rms": {
            column.key: {name: part[:, i].tolist() for name, part in by_step.items()}
            for i, column in enumerate(columns)
        },
        "absolute_error": {
            _percent(share): {
                column.key: quantile[:, i].tolist() for i, column in enumerate(columns)
            }
            for share, quantile in zip(SHARES, scores.quantiles, strict=True)
        },
    }


def _quantile_figures(scores: Scores, comparison: Comparison) -> Figures:
    at_marks, keys = scores.quantiles_at_marks(), [column.key for column in comparison.columns]
    return {
        f"after_{step * comparison.dt_s:g}_s": {
            _percent(share): _by_state(at_marks.at(q, m), keys) for q, share in enumerate(SHARES)
        }
        for m, step in enumerate(scores.marked_steps)
    }


def _ratio_figures(ratios: dict[str, Ratio], columns: Columns) -> Figures:
    names = [column.name for column in columns]
    return {
        name: _by_state(ratio.by_state, names) | _mean_figures(ratio)
        for name, ratio in ratios.items()
    }


def _mean_figures(ratio: Ratio) -> Figures:
    figures = {"geometric_mean": _numbers(ratio.geometric_mean)}
    if ratio.without_progress is not None:
        figures[f"geometric_mean_without_{PROGRESS}"] = _numbers(ratio.without_progress)
    return figures


def _squared(estimate: Estimate, columns: Columns) -> Figures:
    return _by_state(estimate, [column.squared_key for column in columns])


def _by_state(estimate: Estimate, keys: list[str]) -> Figures:
    return {key: _numbers(estimate.at(i)) for i, key in enumerate(keys)}


def _numbers(estimate: Estimate) -> Figures:
    return {name: float(part) for name, part in estimate._asdict().items()}


def _percent(share: float) -> str:
    """A share as a key: "p90"."""
    return f"p{100 * share:g}"
