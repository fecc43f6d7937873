"""The figures of an evaluation for `--json`: everything that is printed, and the steps between."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from offline.bootstrap import CONFIDENCE, RESAMPLES, SEED, Estimate
from offline.evaluate import (
    SHARES,
    Scores,
    mse,
    mse_on_road,
    quantiles_at_marks,
    rms,
    rms_by_step,
)
from offline.judgement import (
    WORST_ON_NEW_ROADS,
    Judgement,
    growth_from_library,
    is_within_goal,
    ratios_to_rivals,
)
from offline.ratios import Ratio
from offline.table_units import Column
from offline.test_sets import LIBRARY, NEW_ROADS, TestSet

Figures = dict[str, Any]
Columns = tuple[Column, ...]


def judgement_figures(judgement: Judgement) -> Figures:
    """All of it; an interval is {value, low, high}."""
    return {
        "judged": list(judgement.judged),
        "rivals": list(judgement.rivals),
        "dt_s": judgement.dt_s,
        "bootstrap": {
            "by": "episode",
            "resamples": RESAMPLES,
            "confidence": CONFIDENCE,
            "seed": SEED,
        },
        "sets": {test.name: _set_figures(judgement, test) for test in judgement.sets},
    }


def pooled_figures(judgement: Judgement) -> Figures:
    """The table over all roads of the library alone."""
    columns, library = judgement.columns, judgement.sets[0]
    return {
        "n_trajectories": library.n_trajectories,
        "n_episodes": library.n_episodes,
        "models": {
            name: {"mse": _by_state(mse(scores), columns, squared=True)}
            for name, scores in judgement.library.items()
        },
    }


def _set_figures(judgement: Judgement, test: TestSet) -> Figures:
    columns, scores = judgement.columns, judgement.scores[test.name]
    figures: Figures = {
        "words": test.words,
        "data_sha256": test.data_sha256,
        "n_trajectories": test.n_trajectories,
        "n_episodes": test.n_episodes,
        "models": {name: _model_figures(scores[name], columns) for name in judgement.names},
        "rival_mse_over_model_mse": {
            model: {
                rival: _ratio_figures(ratio, columns)
                for rival, ratio in ratios_to_rivals(judgement, model, test.name).items()
            }
            for model in judgement.judged
        },
    }
    if test.name == LIBRARY:
        figures["absolute_error_quantiles"] = {
            model: _quantile_figures(scores[model], judgement) for model in judgement.judged
        }
        figures["by_step"] = {
            name: _step_figures(scores[name], columns) for name in judgement.names
        }
    else:
        figures["mse_over_library_mse"] = {
            name: _ratio_figures(growth_from_library(judgement, name, test.name), columns)
            for name in judgement.names
        }
    if test.name == NEW_ROADS:
        figures["goal"] = WORST_ON_NEW_ROADS
        figures["is_within_goal"] = {
            name: is_within_goal(growth_from_library(judgement, name, test.name).by_state)
            for name in judgement.names
        }
    return figures


def _model_figures(scores: Scores, columns: Columns) -> Figures:
    return {
        "mse": _by_state(mse(scores), columns, squared=True),
        "rms": _by_state(rms(scores), columns),
        "mse_by_curvature_per_m": {
            f"{curvature:g}": _by_state(mse_on_road(scores, curvature), columns, squared=True)
            for curvature in scores.squared_on_road
        },
        "trajectories_without_finite_prediction": scores.diverged,
    }


def _step_figures(scores: Scores, columns: Columns) -> Figures:
    """Lists of one number a step, from the first to the last."""
    by_step = rms_by_step(scores)
    return {
        "rms": {
            column.key: {part: getattr(by_step, part)[:, i].tolist() for part in Estimate._fields}
            for i, column in enumerate(columns)
        },
        "absolute_error": {
            _share_key(share): {
                column.key: scores.quantiles[q, :, i].tolist() for i, column in enumerate(columns)
            }
            for q, share in enumerate(SHARES)
        },
    }


def _quantile_figures(scores: Scores, judgement: Judgement) -> Figures:
    at_marks = quantiles_at_marks(scores)
    return {
        f"after_{step * judgement.dt_s:g}_s": {
            _share_key(share): _by_state(at_marks.at(q, m), judgement.columns)
            for q, share in enumerate(SHARES)
        }
        for m, step in enumerate(scores.marked.steps)
    }


def _ratio_figures(ratio: Ratio, columns: Columns) -> Figures:
    return {
        **{column.name: _numbers(ratio.by_state.at(i)) for i, column in enumerate(columns)},
        "geometric_mean": _numbers(ratio.geometric_mean),
    }


def _by_state(estimate: Estimate, columns: Columns, squared: bool = False) -> Figures:
    return {
        column.squared_key if squared else column.key: _numbers(estimate.at(i))
        for i, column in enumerate(columns)
    }


def _numbers(estimate: Estimate) -> Mapping[str, float]:
    return {name: float(np.asarray(part)) for name, part in estimate._asdict().items()}


def _share_key(share: float) -> str:
    return f"p{100 * share:g}"
