"""The validation score that the settings of baselines are chosen by: the log error over 2 s.

It is the mean over the states of log(mean squared error / variance of the state). A tenth less
error counts the same in every state, and differences of the score are logarithms of the geometric
mean ratio that models are compared by.
"""

import numpy as np
from numpy.typing import NDArray

from offline.data.dataset import Dataset
from offline.data.trajectories import Trajectories
from offline.evaluation.predictor import Predictor, prediction_errors
from rt_controller.contract.arrays import Array

_SMALLEST_SHARE = 1e-15
"""of the variance, added to the error so that the logarithm is finite"""


def log_error(predictor: Predictor, windows: Trajectories) -> float:
    """Mean log error of the states over steps 1..K; infinite if a prediction is not finite."""
    errors = prediction_errors(predictor, windows)
    return log_mean_square(errors, variances(windows.x), _SMALLEST_SHARE)


def log_mean_square(errors: Array, unit: Array | float = 1.0, added: float = 0.0) -> float:
    """Mean over the states of log(mean square / unit + added) of errors (N, K, n).

    Infinite if an error is not finite.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        squares = np.square(errors).mean(axis=(0, 1)) / unit
    return float(np.log(squares + added).mean()) if np.all(np.isfinite(squares)) else np.inf


def variances(x: NDArray[np.floating]) -> Array:
    """(n,) variance of each state over windows (N, K+1, n); 1 for a constant state."""
    found = x.reshape(-1, x.shape[-1]).astype(np.float64).var(axis=0)
    return np.where(found > 0.0, found, 1.0)


def tuning_windows(dataset: Dataset, most: int = 1_200) -> Trajectories:
    """At most `most` windows of the validation part, evenly spread over it."""
    windows = dataset.select("validation")
    return windows.take(slice(None, None, -(-len(windows.episode) // most) or 1))
