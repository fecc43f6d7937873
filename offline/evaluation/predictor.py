"""The protocol of every model that can be evaluated."""

from typing import Protocol

import numpy as np

from offline.data.signals import Trajectories
from rt_controller.contract.arrays import Array

_BATCH = 8_000
"""trajectories predicted at once, which limits the memory"""


class Predictor(Protocol):
    """Predicts the states of the car over a horizon, open loop and in physical units.

    Bundles (`offline.model.bundle_predictor.BundlePredictor`), fitted baselines and a model of
    your own all have this one method; evaluation needs nothing else of them.

        class Persistence:
            def predict(self, x0, past, U, W):
                return np.repeat(x0[:, None], U.shape[1] + 1, axis=1)
    """

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """Predicted states (batch, K+1, n); `[:, 0]` is x0, `[:, k]` the state after k periods.

        No state after x0 is shown to the model: a lifted model lifts once, at x0, as the
        controller does over its horizon. All arguments are in the units of the data set's schema
        (for the car: SI, `rt_controller.contract.signals`); a prediction that diverges is returned
        as infinity or NaN, not raised.

        Args:
            x0: measured first states (batch, n).
            past: the periods before x0, oldest first (batch, H, h): the states and inputs that
                `offline.data.signals.past_names` lists. A model reads the last rows that it needs.
            U: inputs (batch, K, m), each held over one period.
            W: exogenous signals (batch, K, p), for the car the curvature of the road in 1/m, each
                held over one period.
        """
        ...


def predict_trajectories(model: Predictor, trajectories: Trajectories) -> Array:
    """Predicted states (N, K+1, n) of these trajectories, in double precision."""
    x, u, w, past = (array.astype(np.float64) for array in trajectories[:4])
    with np.errstate(over="ignore", invalid="ignore"):
        return model.predict(x[:, 0], past, u, w)


def prediction_errors(model: Predictor, trajectories: Trajectories) -> Array:
    """Errors (N, K, n) of steps 1..K in double precision, predicted minus measured."""
    parts = []
    for first in range(0, len(trajectories.episode), _BATCH):
        part = trajectories.take(slice(first, first + _BATCH))
        with np.errstate(over="ignore", invalid="ignore"):
            parts.append((predict_trajectories(model, part) - part.x)[:, 1:])
    return np.concatenate(parts)
