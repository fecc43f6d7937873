"""How far a model is off on the validation part, and how much less that is than a rival's."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from offline.predictor import Predictor
from offline.trajectories import Trajectories

Array = NDArray[np.float64]

CHUNK = 2_000
"""trajectories predicted at once: a matter of memory"""


@dataclass(frozen=True, slots=True)
class Score:
    """A model beside a rival on the same trajectories."""

    ratios: tuple[float, ...]
    """of each state: the rival's mean squared error over the model's, so more is better"""
    geometric_mean: float
    """of the ratios"""


def mean_squared_errors(model: Predictor, trajectories: Trajectories) -> Array:
    """Of each state (n,), over the steps 1..K and the trajectories, in squared units of the state.

    Infinite where a prediction is not finite.
    """
    total = 0.0
    for first in range(0, len(trajectories.episode), CHUNK):
        part = trajectories.take(slice(first, first + CHUNK))
        x, u, w, past = (array.astype(np.float64) for array in part[:4])
        with np.errstate(over="ignore", invalid="ignore"):
            errors = (model.predict(x[:, 0], past, u, w) - x)[:, 1:]
            total = total + np.square(errors).mean(axis=1).sum(axis=0)
    mean = np.asarray(total / len(trajectories.episode))
    return np.where(np.isfinite(mean), mean, np.inf)


def score(errors: Array, rivals: Array) -> Score:
    """Of mean squared errors (n,) beside a rival's."""
    ratios = rivals / errors
    with np.errstate(divide="ignore"):
        mean = float(np.exp(np.log(ratios).mean()))
    return Score(tuple(float(ratio) for ratio in ratios), mean)
