"""How far a model is off on the validation part, and how much less that is than a rival's.

A trained network is scored as it lies in its checkpoint: making a bundle of it takes seconds, and
a tuner asks after every evaluation.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from offline.batch import Batch, scale
from offline.checkpoint import Checkpoint
from offline.dataset import Dataset
from offline.horizon_loss import state_errors
from offline.model import MdkNet, sizes_of
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
    return _finite(np.asarray(total / len(trajectories.episode)))


@dataclass(frozen=True, slots=True)
class Assessment:
    """What a checkpoint's model is worth."""

    errors: Array
    """(n,) mean squared errors as `mean_squared_errors` has them"""
    spectral_radius: float
    """of A; not a number where A is none"""
    n_parameters: int


def assess(checkpoint: Checkpoint, dataset: Dataset) -> Assessment:
    """The model on the validation part."""
    schema, roles, config = dataset.schema, dataset.roles, checkpoint.config
    model = MdkNet(config, sizes_of(schema, roles))
    model.load_state_dict(checkpoint.model)
    validation = dataset.select("validation")
    batch = scale(validation, checkpoint.scaling, schema, roles, config.history_steps)
    n = batch.x.shape[1]
    errors = torch.zeros(model.sizes.states, dtype=torch.float64)
    with torch.no_grad():
        for first in range(0, n, CHUNK):
            part = Batch(*(series[:, first : first + CHUNK] for series in batch))
            errors += part.x.shape[1] / n * state_errors(model, part).double()
        A = model.operator().A.double().numpy()
    finite = np.all(np.isfinite(A))
    radius = float(np.max(np.abs(np.linalg.eigvals(A)))) if finite else float("nan")
    count = sum(parameter.numel() for parameter in model.parameters())
    return Assessment(_finite(errors.numpy() * checkpoint.scaling.x_scale**2), radius, count)


def score(errors: Array, rivals: Array) -> Score:
    """Of mean squared errors (n,) beside a rival's."""
    ratios = rivals / errors
    with np.errstate(divide="ignore"):
        mean = float(np.exp(np.log(ratios).mean()))
    return Score(tuple(float(ratio) for ratio in ratios), mean)


def _finite(errors: Array) -> Array:
    return np.where(np.isfinite(errors), errors, np.inf)
