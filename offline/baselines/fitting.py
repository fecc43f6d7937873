"""What the fits share: ridge regression of single steps, the score of settings, scaled windows.

Sums of products are accumulated chunk by chunk in double precision; each ridge then needs one
solve. The regression is of the change over a step, so the ridge pulls A towards the identity;
towards zero it would make integrating states decay.

The score is the log error over 2 s on the validation part: the mean over the states of log(mean
squared error / variance of the state). A tenth less error counts the same in every state, and
differences of the score are logarithms of the geometric mean ratio that models are compared by.
"""

from collections.abc import Callable, Iterable
from typing import Generic, NamedTuple, TypeVar

import numpy as np
import scipy.linalg

from offline.data.dataset import Dataset
from offline.data.signals import Scaling, Trajectories, history_rows, last_rows
from offline.evaluation.predictor import Predictor, prediction_errors
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import DatasetError

RIDGES = (1e-10, 1e-8, 1e-6, 1e-5, 1e-4, 1e-3)
_MOST_TRANSITIONS, _CHUNK = 250_000, 10_000
_SMALLEST_SHARE = 1e-15
"""of the variance, added to the error so that the logarithm is finite"""

Model = TypeVar("Model", bound=Predictor)


class Transitions(NamedTuple):
    """M single steps of many trajectories, scaled."""

    x: Array
    """(M, 2, n) states before and after"""
    u: Array
    """(M, m)"""
    w: Array
    """(M, p)"""
    past: Array
    """(M, 2, H, h) past before each of the two"""


class Candidate(NamedTuple, Generic[Model]):
    """A structure whose numbers are fitted with every ridge."""

    data: Transitions
    regression: Callable[[Transitions], tuple[Array, Array]]
    """some steps → regressors (M, r) and targets (M, n)"""
    models: Callable[[Array, float], Iterable[Model]]
    """operator (n, r) and its ridge → the models to try with it"""


def fit_ridge(
    dataset: Dataset, candidates: Iterable[Candidate[Model]], ridges: Iterable[float]
) -> Model:
    """The model with the smallest validation score of all candidates and ridges.

    Raises:
        DatasetError: no model predicts finite numbers, or there is none.
    """
    fitted = (
        model
        for candidate in candidates
        for moments in [moments_of(candidate.data, candidate.regression)]
        for ridge in ridges
        for model in candidate.models(ridge_solution(*moments, ridge), ridge)
    )
    return best_model(fitted, dataset)


def pick_transitions(
    windows: Trajectories, dataset: Dataset, scaling: Scaling, past_steps: int
) -> Transitions:
    """At most 250,000 steps, from all trajectories and at times spread over the horizon."""
    count, steps = windows.u.shape[:2]
    every = -(-count * steps // _MOST_TRANSITIONS)
    row, time = np.divmod(np.arange(count * steps), steps)
    chosen = (time + row) % every == 0
    row, time = row[chosen], time[chosen]
    rows = history_rows(windows, dataset.schema, dataset.roles, past_steps)
    both = time[:, None] + np.arange(2)
    past = rows[row[:, None, None], both[..., None] + np.arange(past_steps)].astype(np.float64)
    return Transitions(
        scaling.normalise_states(windows.x[row[:, None], both].astype(np.float64)),
        windows.u[row, time].astype(np.float64) / scaling.u_scale,
        windows.w[row, time].astype(np.float64) / scaling.w_scale,
        (past - scaling.past_centre) / scaling.past_scale,
    )


def moments_of(
    data: Transitions, regression: Callable[[Transitions], tuple[Array, Array]]
) -> tuple[Array, Array]:
    """Mean products of the regressors with each other (r, r) and with the targets (r, n)."""
    count = len(data.u)
    gram, cross = np.zeros(()), np.zeros(())
    for first in range(0, count, _CHUNK):
        part = Transitions(*(series[first : first + _CHUNK] for series in data))
        rows, targets = regression(part)
        gram = gram + rows.T @ rows / count
        cross = cross + rows.T @ targets / count
    return gram, cross


def ridge_solution(gram: Array, cross: Array, ridge: float) -> Array:
    """The operator (n, r) with the smallest squared error plus `ridge` > 0 times its squared size.

    The size is measured in units of each regressor's root mean square.
    """
    spread = np.sqrt(np.diag(gram))
    spread = np.where(spread > 0.0, spread, 1.0)
    correlations = gram / spread[:, None] / spread[None, :]
    correlations[np.diag_indices_from(correlations)] += ridge
    scaled = scipy.linalg.solve(correlations, cross / spread[:, None], assume_a="pos")
    return np.asarray((scaled / spread[:, None]).T)


def log_error(predictor: Predictor, windows: Trajectories) -> float:
    """Mean log error of the states over steps 1..K; infinite if a prediction is not finite.

    A state that is constant counts with variance 1.
    """
    errors = prediction_errors(predictor, windows)
    variance = windows.x.reshape(-1, windows.x.shape[-1]).astype(np.float64).var(axis=0)
    with np.errstate(over="ignore", invalid="ignore"):
        squares = np.square(errors).mean(axis=(0, 1)) / np.where(variance > 0.0, variance, 1.0)
    finite = np.all(np.isfinite(squares))
    return float(np.log(squares + _SMALLEST_SHARE).mean()) if finite else np.inf


def tuning_windows(dataset: Dataset, most: int = 1_200) -> Trajectories:
    """At most `most` windows of the validation part, evenly spread over it."""
    windows = dataset.select("validation")
    return windows.take(slice(None, None, -(-len(windows.episode) // most) or 1))


def best_model(models: Iterable[Model], dataset: Dataset) -> Model:
    """The first of the fitted models with the smallest log error on the validation part.

    Raises:
        DatasetError: no model predicts finite numbers.
    """
    validation = tuning_windows(dataset)
    smallest, best = np.inf, None
    for model in models:
        score = log_error(model, validation)
        if score < smallest:
            smallest, best = score, model
    if best is None:
        raise DatasetError(
            "expected a model that predicts finite numbers over the validation part, found none "
            "among the settings of this baseline. Leave it out, or give it other settings."
        )
    return best


def scale_windows(
    scaling: Scaling, past_steps: int, x0: Array, past: Array, U: Array, W: Array
) -> tuple[Array, Array, Array, Array]:
    """Scaled x0, U, W and last `past_steps` rows of the past; arguments of `Predictor.predict`."""
    rows_of_past = (last_rows(past, past_steps) - scaling.past_centre) / scaling.past_scale
    return scaling.normalise_states(x0), U / scaling.u_scale, W / scaling.w_scale, rows_of_past
