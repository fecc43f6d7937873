"""One training of a comparison or a study: it starts, or continues from its checkpoint.

The task may run several times and on any machine: its folder holds its progress and its result.
The caller holds the lock of the folder, so that only one process trains in it.
"""

import json
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Literal

from filelock import FileLock
from pydantic import TypeAdapter

from offline.config import TrainingConfig, assumed_fields
from offline.data.dataset import Dataset, load_dataset
from offline.experiments.error_ratios import ErrorRatios, checkpoint_mse, error_ratios
from offline.experiments.running_command import RunningCommand
from offline.files import write_json
from offline.model.export_checks import limits_of
from offline.model.spectrum import driven_radius
from offline.training.checkpoint import Checkpoint, load_checkpoint
from offline.training.export import restore_model
from offline.training.recovery import TrainingDivergedError
from offline.training.run_folder import LATEST_LINK, RunFolder, create_run, open_run
from offline.training.schedule import is_evaluated
from offline.training.state import TrainingState
from offline.training.train import train
from rt_controller.contract.errors import ArtifactError, ConfigError, DatasetError

CPU_TIME_FILE = "cpu-time.json"
LOCK_FILE = "lock"
RESULT_FILE = "result.json"
LOCK_POLL_S = 0.2

_ONE_TRAINING = threading.Lock()
"""torch has one random generator and one number of threads per process"""


@dataclass(frozen=True, slots=True)
class CampaignData:
    """The data set and the linear model that all trainings of a command share."""

    folder: Path
    sha256: str
    states: tuple[str, ...]
    linear_mse: tuple[float, ...]
    """(n,) of the fair linear model on the validation part"""


@dataclass(frozen=True, slots=True)
class Training:
    """Configuration, data and folder of one training."""

    folder: Path
    config: TrainingConfig
    data: CampaignData


@dataclass(frozen=True, slots=True)
class Result:
    """How a training ended."""

    ending: Literal["finished", "diverged", "refused", "pruned"]
    """diverged: the loss is not finite; refused: the model cannot be exported; pruned: the study
    stopped a training that was worse than the median"""
    step: int
    """of the model that was evaluated; without one, the last step"""
    training_cpu_s: float
    """of all threads; other programs on the machine do not count"""
    reason: str = ""
    """why there are no ratios"""
    ratios: ErrorRatios | None = None
    """on the validation part"""
    spectral_radius: float | None = None
    """of A"""
    n_parameters: int | None = None


def folder_lock(folder: Path) -> FileLock:
    """The lock of a folder; the operating system releases it when the process ends or dies."""
    return FileLock(folder / LOCK_FILE)


def find_run(training: Training) -> RunFolder | None:
    """The run of a training, None: not started; `ConfigError` if of another one, or other data."""
    latest = training.folder / LATEST_LINK
    if not latest.exists():
        return None
    run = open_run(latest)
    found, expected = run.config.model_dump(), training.config.model_dump()
    assumed = assumed_fields(run.config)
    different = [name for name in expected if found[name] != expected[name] or name in assumed]
    if run.data_sha256 != training.data.sha256:
        different.append("data set")
    if different:
        raise ConfigError(
            f"{training.folder}: expected a training of the same configuration, found one that "
            f"differs in {', '.join(different)}. Choose another --folder, or delete this one."
        )
    return run


def run_training(
    training: Training,
    command: RunningCommand,
    on_evaluation: Callable[[RunFolder], bool] = lambda run: True,
) -> Result | None:
    """The result of the training, None: stopped before its end; errors as from `find_run`.

    `on_evaluation` is called after each evaluation and its checkpoint; False prunes the training.
    """
    run = find_run(training)
    result = load_result(training.folder)
    if result is None:
        with _ONE_TRAINING:
            result = _train(training, run, command, on_evaluation)
        if result is not None:
            write_json(training.folder / RESULT_FILE, asdict(result))
    return result


def load_result(folder: Path) -> Result | None:
    """The result in that folder, None: it has not ended; `ArtifactError` for other content."""
    file = folder / RESULT_FILE
    try:
        return TypeAdapter(Result).validate_json(file.read_bytes())
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise ArtifactError(
            f"{file}: expected the result of a training, found something else ({error}). Delete "
            f"it; the training continues from its checkpoint."
        ) from error


def _train(
    training: Training,
    run: RunFolder | None,
    command: RunningCommand,
    on_evaluation: Callable[[RunFolder], bool],
) -> Result | None:
    data, config = training.data, training.config
    dataset = shared_dataset(data.folder, data.sha256)
    run = run or create_run(training.folder, config, data.folder, data.sha256, datetime.now())
    checkpoint = load_checkpoint(run.last) if run.last.exists() else None
    count_cpu_s = _cpu_time(run.path / CPU_TIME_FILE)
    is_pruned = False

    def on_progress(state: TrainingState) -> None:
        nonlocal is_pruned
        if is_evaluated(state.step, config):
            count_cpu_s()
            is_pruned = not on_evaluation(run)

    try:
        outcome = train(
            config,
            dataset,
            run,
            resume_from=checkpoint,
            on_progress=on_progress,
            stop_requested=lambda: is_pruned or command.is_stopped(),
        )
    except TrainingDivergedError as error:
        step = load_checkpoint(run.last).step if run.last.exists() else 0
        return Result("diverged", step, count_cpu_s(), str(error).removeprefix(f"{run.path}: "))
    if not outcome.is_finished:
        return Result("pruned", outcome.step, count_cpu_s()) if is_pruned else None
    return _evaluate(load_checkpoint(run.best), dataset, data, count_cpu_s())


def _evaluate(best: Checkpoint, dataset: Dataset, data: CampaignData, cpu_s: float) -> Result:
    model = restore_model(best, dataset.schema, dataset.roles)
    radius = driven_radius(model)
    n_parameters = sum(parameter.numel() for parameter in model.parameters())
    if not radius <= limits_of(best.config).radius:
        reason = f"spectral radius {radius:.5f} under inputs, which offline-export would refuse"
        return Result("refused", best.step, cpu_s, reason, None, radius, n_parameters)
    ratios = error_ratios(checkpoint_mse(best, dataset), data.linear_mse)
    return Result("finished", best.step, cpu_s, "", ratios, radius, n_parameters)


@lru_cache(maxsize=1)
def shared_dataset(folder: Path, sha256: str) -> Dataset:
    """The data set in that folder, loaded once per process; `DatasetError` if it is another one."""
    dataset = load_dataset(folder)
    if dataset.sha256 != sha256:
        raise DatasetError(
            f"{folder}: expected the data set {sha256:.16}…, found {dataset.sha256:.16}…. Share "
            f"one data folder between all workers, and do not change it while they train."
        )
    return dataset


def _cpu_time(file: Path) -> Callable[[], float]:
    """A function that returns and stores the CPU time of a run since its start, in s.

    If the process is killed, the time since the last checkpoint is not counted.
    """
    before_s = json.loads(file.read_text(encoding="utf-8"))["cpu_s"] if file.exists() else 0.0
    begun_s = time.process_time()

    def count() -> float:
        cpu_s = float(before_s + time.process_time() - begun_s)
        write_json(file, {"cpu_s": cpu_s})
        return cpu_s

    return count
