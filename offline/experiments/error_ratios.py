"""Prediction errors of a model on the validation part, as ratios to those of a linear model.

A network is evaluated from its checkpoint, because exporting a bundle takes seconds.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from offline.baselines import registry
from offline.data.dataset import Dataset
from offline.data.sampling import scale
from offline.evaluation.comparison import LTI_BASELINES
from offline.evaluation.metrics import geometric_mean
from offline.evaluation.predictor import Predictor, prediction_errors
from offline.model.losses import state_errors
from offline.training.checkpoint import Checkpoint
from offline.training.export import restore_model
from rt_controller.contract.arrays import Array

CHUNK = 2_000
"""trajectories predicted at once, to limit the memory"""


@dataclass(frozen=True, slots=True)
class ErrorRatios:
    """Mean squared errors of the linear model over those of a model: more is better."""

    by_state: tuple[float, ...]
    geometric_mean: float


def error_ratios(mse: Array, linear_mse: Sequence[float]) -> ErrorRatios:
    """Ratios of two mean squared errors (n,)."""
    ratios = np.asarray(linear_mse) / mse
    return ErrorRatios(tuple(map(float, ratios)), float(geometric_mean(ratios)))


def checkpoint_mse(checkpoint: Checkpoint, dataset: Dataset) -> Array:
    """Mean squared errors (n,) of the model of a checkpoint, as `mean_squared_errors`."""
    schema, roles, config = dataset.schema, dataset.roles, checkpoint.config
    model = restore_model(checkpoint, schema, roles)
    validation = dataset.select("validation")
    batch = scale(validation, checkpoint.scaling, schema, roles, config.history_steps)
    errors = torch.zeros(model.sizes.states, dtype=torch.float64)
    with torch.no_grad():
        for share, part in batch.chunks(CHUNK):
            errors += share * state_errors(model, part).double()
    return _finite(errors.numpy() * checkpoint.scaling.x_scale**2)


def mean_squared_errors(model: Predictor, dataset: Dataset) -> Array:
    """Mean squared error (n,) over steps 1..K of the validation part, in squared SI units.

    Infinite for a state with a prediction that is not finite.
    """
    errors = prediction_errors(model, dataset.select("validation"))
    with np.errstate(over="ignore", invalid="ignore"):
        return _finite(np.square(errors).mean(axis=(0, 1)))


def linear_mse(dataset: Dataset) -> Array:
    """Mean squared errors (n,) of the fair linear model on the validation part.

    In each state, those of the better of one model for all roads and one for each curvature.
    """
    fitted = (
        registry.fit(name, dataset).baseline
        for name in LTI_BASELINES
        if registry.find_baseline(name).find_objection(dataset) is None
    )
    return np.asarray(np.min([mean_squared_errors(model, dataset) for model in fitted], axis=0))


def _finite(errors: Array) -> Array:
    return np.where(np.isfinite(errors), errors, np.inf)
