"""The validation score that the settings of baselines are chosen by: the log error over 2 s.

It is the mean over the states of log(mean squared error / variance of the state). A tenth less
error counts the same in every state, and differences of the score are logarithms of the geometric
mean ratio that models are compared by.
"""

from collections.abc import Iterable
from typing import TypeVar

import numpy as np

from offline.data.dataset import Dataset
from offline.data.trajectories import Trajectories
from offline.evaluation.predictor import Predictor, prediction_errors
from rt_controller.contract.errors import DatasetError

Model = TypeVar("Model", bound=Predictor)

_SMALLEST_SHARE = 1e-15
"""of the variance, added to the error so that the logarithm is finite"""


def log_error(predictor: Predictor, windows: Trajectories) -> float:
    """Mean log error of the states over steps 1..K; infinite if a prediction is not finite.

    A state that is constant counts with variance 1.
    """
    errors = prediction_errors(predictor, windows)
    x = windows.x.reshape(-1, windows.x.shape[-1]).astype(np.float64)
    variance = x.var(axis=0)
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
