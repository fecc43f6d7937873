"""How well a model predicts two seconds ahead, in the form of the paper's Table I.

Mean squared error over the steps 1..80 and over trajectories held out by episode, in squared
km/h, deg/s, m and deg as printed there.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offline.dataset import Trajectories
from offline.predictor import Predictor

Array = NDArray[np.float64]

TRAJECTORIES_PER_CURVATURE = 480
"""five curvatures of these make the paper's 2,400 test trajectories"""

PER_UNIT = np.array([3.6, 3.6, np.degrees(1.0), 1.0, 1.0, np.degrees(1.0)])
"""from SI to the units of Table I"""


class StateErrors(NamedTuple):
    """Mean squared errors of the six states, in squared units of Table I."""

    vx: float
    vy: float
    yaw_rate: float
    ds: float
    ey: float
    epsi: float


UNITS = {
    "vx": "(km/h)^2",
    "vy": "(km/h)^2",
    "yaw_rate": "(deg/s)^2",
    "ds": "m^2",
    "ey": "m^2",
    "epsi": "deg^2",
}


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Errors of several models on the same trajectories."""

    n_trajectories: int
    pooled: Mapping[str, StateErrors]
    """by name of the model"""
    per_curvature: Mapping[float, Mapping[str, StateErrors]]
    """by curvature in 1/m, then by name of the model"""


def choose_test_trajectories(test: Trajectories) -> Trajectories:
    """The first 480 trajectories of each curvature, or all where there are fewer."""
    chosen = [
        np.flatnonzero(test.kappa == kappa)[:TRAJECTORIES_PER_CURVATURE]
        for kappa in np.unique(test.kappa)
    ]
    return test.take(np.concatenate(chosen))


def evaluate(models: Mapping[str, Predictor], test: Trajectories) -> Evaluation:
    """Errors of each model, pooled and for each curvature."""
    squared = {name: squared_errors(model, test) for name, model in models.items()}
    curvatures = [float(kappa) for kappa in np.unique(test.kappa)]
    return Evaluation(
        n_trajectories=len(test.kappa),
        pooled={name: _mean(errors) for name, errors in squared.items()},
        per_curvature={
            round(kappa, 9): {
                name: _mean(errors[test.kappa == np.float32(kappa)])
                for name, errors in squared.items()
            }
            for kappa in curvatures
        },
    )


def squared_errors(model: Predictor, test: Trajectories) -> Array:
    """Squared errors (N, K, 6) of the steps 1..K, in squared units of Table I."""
    x = test.x.astype(np.float64)
    predicted = model.predict(x[:, 0], test.u.astype(np.float64), test.kappa.astype(np.float64))
    return np.asarray(np.square((predicted - x)[:, 1:] * PER_UNIT))


def _mean(errors: Array) -> StateErrors:
    return StateErrors(*(float(error) for error in errors.mean(axis=(0, 1))))
