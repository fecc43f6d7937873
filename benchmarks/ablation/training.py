"""One training, and its errors as ratios to those of a linear model.

The task may run in any process and on any machine that has the folder. A network is evaluated from
its checkpoint, because exporting a bundle takes seconds.
"""

import time
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch

from offline.baselines import registry
from offline.config import TrainingConfig
from offline.data.dataset import Dataset, load_dataset
from offline.data.sampling import Batch, scale
from offline.evaluation import metrics
from offline.evaluation.comparison import LTI_BASELINES
from offline.evaluation.predictor import Predictor, prediction_errors
from offline.model.export_checks import limits_of
from offline.model.losses import state_errors
from offline.model.stability import driven_radius
from offline.training.optimizer import is_evaluated
from offline.training.run import Checkpoint, create_run, load_checkpoint, restore_model
from offline.training.state import TrainingDivergedError, TrainingState
from offline.training.train import train
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import DatasetError

CHUNK = 2_000
"""trajectories predicted at once, to limit the memory"""


@dataclass(frozen=True, slots=True)
class SharedData:
    """The data set of all trainings, and the errors of the linear model on it."""

    folder: Path
    sha256: str
    linear_mse: Mapping[str, float]
    """by state: mean squared error of the fair linear model on the validation part"""

    def ratios(self, mse: Array) -> dict[str, float]:
        """By state: error of the linear model over the mean squared errors (n,); more is better."""
        pairs = zip(self.linear_mse.items(), mse, strict=True)
        return {name: float(np.float64(linear) / error) for (name, linear), error in pairs}


@dataclass(frozen=True, slots=True)
class Result:
    """How a training ended."""

    ending: Literal["finished", "diverged", "refused"]
    """diverged: the loss is not finite; refused: the model cannot be exported"""
    step: int
    """of the model that was evaluated; without one, the last step"""
    training_cpu_s: float
    """of all threads; other programs on the machine do not count"""
    reason: str = ""
    """why there are no ratios"""
    mse_ratio: dict[str, float] | None = None
    """by state, on the validation part, as `SharedData.ratios`"""
    geometric_mean_ratio: float | None = None
    spectral_radius: float | None = None
    """the largest under inputs within their bounds"""
    n_parameters: int | None = None


def geometric_mean(ratios: Iterable[float]) -> float:
    """Geometric mean; 0 if one of the ratios is 0."""
    return float(metrics.geometric_mean(np.array([*ratios])))


def checkpoint_mse(checkpoint: Checkpoint, dataset: Dataset) -> Array:
    """Mean squared errors (n,) of the model of a checkpoint, as `mean_squared_errors`."""
    schema, roles, config = dataset.schema, dataset.roles, checkpoint.config
    # In float32 the rounding of speeds near their mean is seen in a small error.
    model = restore_model(checkpoint, schema, roles).double()
    validation = dataset.select("validation")
    batch = scale(validation, checkpoint.scaling, schema, roles, config.history_steps)
    errors = torch.zeros(model.sizes.states, dtype=torch.float64)
    with torch.no_grad():
        for share, part in batch.chunks(CHUNK):
            errors += share * state_errors(model, Batch(*(each.double() for each in part)))
    return _finite(errors.numpy() * checkpoint.scaling.x_scale**2)


def mean_squared_errors(model: Predictor, dataset: Dataset) -> Array:
    """Mean squared error (n,) over steps 1..K of the validation part, in squared SI units.

    Infinite for a state with a prediction that is not finite.
    """
    errors = prediction_errors(model, dataset.select("validation"))
    with np.errstate(over="ignore", invalid="ignore"):
        return _finite(np.square(errors).mean(axis=(0, 1)))


def _finite(errors: Array) -> Array:
    return np.where(np.isfinite(errors), errors, np.inf)


def measure_linear_model(folder: Path, dataset: Dataset) -> SharedData:
    """The data set in that folder with the errors of the fair linear model.

    In each state, those of the better of one model for all roads and one for each curvature.
    """
    fitted = (
        registry.fit(name, dataset)
        for name in LTI_BASELINES
        if registry.find_baseline(name).find_objection(dataset) is None
    )
    errors = np.min([mean_squared_errors(model, dataset) for model in fitted], axis=0)
    by_state = dict(zip(dataset.schema.state_names, map(float, errors), strict=True))
    return SharedData(folder.resolve(), dataset.sha256, by_state)


def run_training(folder: Path, config: TrainingConfig, data: SharedData) -> dict[str, Any]:
    """The fields of the `Result` of a training with a new run in that folder."""
    return asdict(_train(folder, config, data))


def _train(folder: Path, config: TrainingConfig, data: SharedData) -> Result:
    dataset = _shared_dataset(data.folder, data.sha256)
    run = create_run(folder, config, data.folder, data.sha256, datetime.now())
    begun_s, step = time.process_time(), 0

    def on_progress(state: TrainingState) -> None:
        nonlocal step
        if is_evaluated(state.step, config):
            step = state.step

    try:
        train(config, dataset, run, on_progress=on_progress)
    except TrainingDivergedError as error:
        reason = str(error).removeprefix(f"{run.path}: ")
        return Result("diverged", step, time.process_time() - begun_s, reason)
    cpu_s = time.process_time() - begun_s
    best = load_checkpoint(run.best)
    model = restore_model(best, dataset.schema, dataset.roles)
    radius = driven_radius(model)
    n_parameters = sum(parameter.numel() for parameter in model.parameters())
    if not radius <= limits_of(config).radius:
        reason = f"spectral radius {radius:.5f} under inputs, which offline-export would refuse"
        return Result("refused", best.step, cpu_s, reason, None, None, radius, n_parameters)
    ratios = data.ratios(checkpoint_mse(best, dataset))
    mean = geometric_mean(ratios.values())
    return Result("finished", best.step, cpu_s, "", ratios, mean, radius, n_parameters)


@lru_cache(maxsize=1)
def _shared_dataset(folder: Path, sha256: str) -> Dataset:
    """The data set in that folder, loaded once per process; `DatasetError` if it is another one."""
    dataset = load_dataset(folder)
    if dataset.sha256 != sha256:
        raise DatasetError(
            f"{folder}: expected the data set {sha256:.16}…, found {dataset.sha256:.16}…. Share "
            f"one data folder between all workers, and do not change it while they train."
        )
    return dataset
