"""Results of an evaluation as a tree for `--json`: all printed numbers, and those of each step."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from offline.evaluation.bootstrap import CONFIDENCE, RESAMPLES, SEED, Estimate
from offline.evaluation.comparison import LINEAR, Comparison, ErrorsByName
from offline.evaluation.metrics import (
    LARGEST_RATIO_ON_NEW_ROADS,
    PROGRESS,
    SHARES,
    WORST_SHARE,
    Ratio,
)
from offline.evaluation.series import Slice
from offline.evaluation.test_sets import LIBRARY, NEW_ROADS, TestSet

Figures = dict[str, Any]
Entries = Iterator[tuple[tuple[str, ...], Any]]
"""a path in the tree, and what stands there"""

_SHARES = [f"p{100 * share:g}" for share in SHARES]


def comparison_figures(comparison: Comparison) -> Figures:
    """All results; a value with an interval is {value, low, high}."""
    bootstrap = {"by": "episode", "resamples": RESAMPLES, "confidence": CONFIDENCE, "seed": SEED}
    return {
        "models": list(comparison.models),
        "baselines": list(comparison.baselines),
        "class_of_baseline": dict(comparison.classes),
        "not_converged": list(comparison.not_converged),
        "dt_s": comparison.dt_s,
        "bootstrap": bootstrap,
        "sets": {test.name: _tree(_of_set(comparison, test)) for test in comparison.sets},
        "series": {
            series.name: {
                "quantity": series.quantity,
                "unit": series.unit,
                "description": series.on,
                "slices": [_tree(_of_slice(comparison, part)) for part in series.slices],
            }
            for series in comparison.series
        },
    }


def library_figures(comparison: Comparison) -> Figures:
    """The MSE table over all roads of the library."""
    library = comparison.sets[0]
    return {
        "n_trajectories": library.n_trajectories,
        "n_episodes": library.n_episodes,
        "models": {
            name: {"mse": _mse(comparison, scores.mse())}
            for name, scores in comparison.library.items()
        },
    }


def _of_set(comparison: Comparison, test: TestSet) -> Entries:
    keys, errors = [each.key for each in comparison.columns], comparison.errors_on(test.name)
    yield ("description",), test.description
    yield ("data_sha256",), test.data_sha256
    yield ("n_trajectories",), test.n_trajectories
    yield ("n_episodes",), test.n_episodes
    for name, scores in comparison.scores[test.name].items():
        yield ("models", name, "mse"), _mse(comparison, scores.mse())
        yield ("models", name, "rms"), _by_state(scores.rms(), keys)
        by_road = {
            f"{kappa:g}": _mse(comparison, errors[name].take(test.is_on_road(kappa)).mean())
            for kappa in test.curvatures_per_m
        }
        yield ("models", name, "mse_by_curvature_per_m"), by_road
        yield ("models", name, "trajectories_without_finite_prediction"), scores.diverged
    yield ("best_baseline",), _best_baseline(comparison, errors)
    for model in comparison.models:
        ratios = comparison.ratios_to_baselines(model, test.name)
        yield ("baseline_mse_over_model_mse", model), _ratios(comparison, ratios)
    if test.name == LIBRARY:
        yield from _of_library(comparison)
        return
    growth = {name: comparison.ratio_to_library(name, test.name) for name in comparison.names}
    yield ("mse_over_library_mse",), _ratios(comparison, growth)
    if test.name == NEW_ROADS:
        yield ("goal",), LARGEST_RATIO_ON_NEW_ROADS
        yield ("is_within_goal",), {name: ratio.is_within_goal for name, ratio in growth.items()}


def _of_library(comparison: Comparison) -> Entries:
    """Quantiles, their ratios, and errors of each step."""
    keys = [column.key for column in comparison.columns]
    names = [column.name for column in comparison.columns]
    path: tuple[str, ...]
    yield ("worst_share",), WORST_SHARE
    for model in comparison.models:
        for share, (_, ratios) in zip(
            _SHARES, comparison.ratios_of_quantiles(model).items(), strict=True
        ):
            path = ("baseline_mse_quantile_over_model_mse_quantile", model, share)
            yield path, _ratios(comparison, ratios)
        scores = comparison.library[model]
        at_marks = scores.quantiles_at_marks()
        for m, step in enumerate(scores.marked_steps):
            after = f"after_{step * comparison.dt_s:g}_s"
            for q, share in enumerate(_SHARES):
                path = ("absolute_error_quantiles", model, after, share)
                yield path, _by_state(at_marks.at(q, m), keys)
    for name, scores in comparison.library.items():
        errors, rms = scores.by_trajectory, scores.rms_by_step()._asdict()
        worst = _by_state(errors.worst_part, names)
        yield ("models", name, "part_of_mse_of_worst_trajectories"), worst
        for q, share in enumerate(_SHARES):
            path = ("models", name, "mse_quantiles_over_trajectories", share)
            yield path, _mse(comparison, errors.quantiles().at(q))
        for i, key in enumerate(keys):
            by_step = {part: values[:, i].tolist() for part, values in rms.items()}
            yield ("by_step", name, "rms", key), by_step
            for q, share in enumerate(_SHARES):
                path = ("by_step", name, "absolute_error", share, key)
                yield path, scores.quantiles[q, :, i].tolist()


def _of_slice(comparison: Comparison, part: Slice) -> Entries:
    errors = comparison.errors_in(part)
    yield ("label",), part.label
    yield ("set",), part.of
    yield from zip([("n_trajectories",), ("n_episodes",)], comparison.size_of(part), strict=True)
    yield ("best_baseline",), _best_baseline(comparison, errors)
    for model in comparison.models:
        ratios = comparison.ratios(model, errors)
        yield ("baseline_mse_over_model_mse", model), _ratios(comparison, ratios)
        least = {name: comparison.columns[each.least_state].name for name, each in ratios.items()}
        yield ("state_of_smallest_ratio", model), least
    for name, each in errors.items():
        yield ("mse", name), _mse(comparison, each.mean())
    growth = {name: comparison.growth(name, each) for name, each in errors.items()}
    yield ("mse_over_library_mse",), _ratios(comparison, growth)


def _tree(entries: Entries) -> Figures:
    """Nested dicts."""
    root: Figures = {}
    for path, value in entries:
        place = root
        for key in path[:-1]:
            place = place.setdefault(key, {})
        place[path[-1]] = value
    return root


def _best_baseline(comparison: Comparison, errors: ErrorsByName) -> dict[str, str]:
    best = comparison.best_linear(errors)
    return {} if best is None else {LINEAR: best}


def _ratios(comparison: Comparison, ratios: Mapping[str, Ratio]) -> Figures:
    """By name: those of the states, and the geometric means."""
    states = [column.name for column in comparison.columns]
    means = ("geometric_mean", f"geometric_mean_without_{PROGRESS}")
    return {
        name: _by_state(ratio.by_state, states)
        | {key: _numbers(mean) for key, mean in zip(means, ratio.means, strict=False)}
        for name, ratio in ratios.items()
    }


def _mse(comparison: Comparison, estimate: Estimate) -> Figures:
    return _by_state(estimate, [column.squared_key for column in comparison.columns])


def _by_state(estimate: Estimate, keys: Iterable[str]) -> Figures:
    return {key: _numbers(estimate.at(i)) for i, key in enumerate(keys)}


def _numbers(estimate: Estimate) -> Figures:
    return {name: float(part) for name, part in estimate._asdict().items()}
