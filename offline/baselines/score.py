"""The one number that rivals are tuned by: how far off they are over two seconds, on validation.

The mean over the states of the logarithm of each one's mean squared error, measured in that
state's own variance. A tenth less of one state's error counts as much as a tenth less of
another's, and e to this number is the geometric mean that models are compared by.
"""

import numpy as np
from numpy.typing import NDArray

from offline.dataset import Dataset
from offline.predictor import Predictor
from offline.trajectories import Trajectories

Array = NDArray[np.float64]

_LEAST = 1e-15
"""share of a state's variance that counts as no error, so that the logarithm stays finite"""


def log_error(predictor: Predictor, windows: Trajectories) -> float:
    """Mean log error of the states over steps 1..K; infinite where a prediction is not finite."""
    x, u, w, past = (series.astype(np.float64) for series in windows[:4])
    with np.errstate(over="ignore", invalid="ignore"):
        predicted = predictor.predict(x[:, 0], past, u, w)
        errors = np.square(predicted - x)[:, 1:].mean(axis=(0, 1)) / variances(x)
    return float(np.log(errors + _LEAST).mean()) if np.all(np.isfinite(errors)) else np.inf


def variances(x: NDArray[np.floating]) -> Array:
    """(n,) variance of each state over windows (N, K+1, n); 1 for one that never moves."""
    found = x.reshape(-1, x.shape[-1]).astype(np.float64).var(axis=0)
    return np.where(found > 0.0, found, 1.0)


def tuning_windows(dataset: Dataset, most: int = 1_200) -> Trajectories:
    """At most so many windows of the validation part, spread evenly over it."""
    windows = dataset.select("validation")
    return windows.take(slice(None, None, -(-len(windows.episode) // most) or 1))
