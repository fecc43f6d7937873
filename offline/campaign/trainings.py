"""One training of a campaign: from nothing, from its checkpoint, or from its finished result.

A task may be started again and again, anywhere: it finds in its folder how far it got. It ends
with a result, or it was stopped and says so.
"""

import json
import os
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from offline.campaign.attempt import Attempt
from offline.campaign.claim import claimed
from offline.campaign.score import Score, assess, score
from offline.checkpoint import load_checkpoint
from offline.config import TrainingConfig
from offline.dataset import Dataset, load_dataset
from offline.export import largest_radius_of
from offline.run_folder import LATEST_LINK, RunFolder, create_run, open_run
from offline.train import Progress, TrainingDivergedError, train
from rt_controller.contract.errors import ArtifactError, ConfigError, DatasetError

RESULT_FILE = "result.json"
SECONDS_FILE = "seconds.json"

Ending = Literal["finished", "diverged", "refused", "pruned"]

_ONE_AT_A_TIME = threading.Lock()
"""torch's dice and its number of threads belong to the process: trainings would share them"""


@dataclass(frozen=True, slots=True)
class Training:
    """What is to be trained, on what, where."""

    folder: Path
    """of this training alone"""
    config: TrainingConfig
    data_folder: Path
    data_sha256: str
    rivals: tuple[float, ...]
    """mean squared errors (n,) of the fair linear model on the validation part"""


@dataclass(frozen=True, slots=True)
class Result:
    """How a training ended."""

    ending: Ending
    """diverged: the loss is no number; refused: the best model may not be exported; pruned: not
    worth going on with"""
    step: int
    """of the model that was scored, or that was the last"""
    training_s: float
    score: Score | None
    """on the validation part"""
    spectral_radius: float | None
    """of A"""
    reason: str
    """why there is no score"""


Report = Callable[[Progress, RunFolder], bool]
"""hears about each evaluation, after its checkpoint; says whether to go on"""


def run_training(
    training: Training,
    attempt: Attempt,
    leader_pid: int,
    on_evaluation: Report = lambda progress, run: True,
) -> Result | None:
    """The result; None if the training was stopped before its end.

    Raises:
        ConfigError: the folder holds a training of another configuration or data set, or is not
            to be seen from here.
    """
    leave_ctrl_c_to(leader_pid)
    if not attempt.is_wanted():
        return None
    training.folder.mkdir(parents=True, exist_ok=True)
    should_stop = attempt.should_stop()
    with claimed(training.folder, should_stop) as is_ours:
        if not is_ours:
            return None
        done = read_result(training.folder)
        if done is not None:
            find_run(training)
            return done
        with _ONE_AT_A_TIME:
            result = _train(training, should_stop, on_evaluation)
        if result is not None:
            _write(training.folder / RESULT_FILE, asdict(result))
        return result


def find_run(training: Training) -> RunFolder | None:
    """The run that was begun in the folder of a training, None if there is none.

    Raises:
        ConfigError: it is of another configuration or data set.
    """
    latest = training.folder / LATEST_LINK
    if not latest.exists():
        return None
    run = open_run(latest)
    changed = [
        name
        for name in TrainingConfig.model_fields
        if getattr(run.config, name) != getattr(training.config, name)
    ]
    if run.data_sha256 != training.data_sha256:
        changed.append("data set")
    if changed:
        raise ConfigError(
            f"{training.folder}: expected a training of the same configuration, found one that "
            f"differs in {', '.join(changed)}. Choose another --folder, or delete this one."
        )
    return run


def is_evaluated(step: int, config: TrainingConfig) -> bool:
    """Whether `offline.train.train` evaluates, and keeps, the model after so many steps."""
    return (step - 1) % config.evaluate_every == 0 or step == config.steps


def read_result(folder: Path) -> Result | None:
    """The result of a training, None if it has not ended.

    Raises:
        ArtifactError: the file is not one of this program.
    """
    file = folder / RESULT_FILE
    if not file.exists():
        return None
    try:
        fields = json.loads(file.read_text(encoding="utf-8"))
        found = fields.pop("score")
        if found is not None:
            found = Score(tuple(found["ratios"]), found["geometric_mean"])
        return Result(**fields, score=found)
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise ArtifactError(
            f"{file}: expected the result of a training, found something else ({error}). Delete "
            f"it; the training goes on from its checkpoint."
        ) from error


def leave_ctrl_c_to(leader_pid: int) -> None:
    """A worker process does not answer Ctrl-C: the command does, and stops its tasks politely."""
    is_worker = os.getpid() != leader_pid
    if is_worker and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _train(
    training: Training, should_stop: Callable[[], bool], on_evaluation: Report
) -> Result | None:
    dataset = open_shared(training.data_folder, training.data_sha256)
    config, run = training.config, find_run(training)
    if run is None:
        now = datetime.now()
        run = create_run(training.folder, config, training.data_folder, training.data_sha256, now)
    checkpoint = load_checkpoint(run.last) if run.last.exists() else None
    watch = _Stopwatch(run.path / SECONDS_FILE)
    go_on = True

    def on_progress(progress: Progress) -> None:
        nonlocal go_on
        if is_evaluated(progress.step, config):
            watch.keep()
            go_on = on_evaluation(progress, run)

    try:
        outcome = train(
            config,
            dataset,
            run,
            resume_from=checkpoint,
            on_progress=on_progress,
            stop_requested=lambda: not go_on or should_stop(),
        )
    except TrainingDivergedError as error:
        step = load_checkpoint(run.last).step if run.last.exists() else 0
        return Result("diverged", step, watch.keep(), None, None, _without_path(error, run))
    seconds = watch.keep()
    if outcome.is_finished:
        return _result(run, dataset, training, seconds)
    return None if go_on else Result("pruned", outcome.step, seconds, None, None, "")


def _result(run: RunFolder, dataset: Dataset, training: Training, seconds: float) -> Result:
    checkpoint = load_checkpoint(run.best)
    found = assess(checkpoint, dataset)
    radius = found.spectral_radius
    if not radius <= largest_radius_of(checkpoint.config):
        reason = f"spectral radius {radius:.5f}, which offline-export would not let pass"
        return Result("refused", checkpoint.step, seconds, None, radius, reason)
    compared = score(found.errors, np.asarray(training.rivals))
    return Result("finished", checkpoint.step, seconds, compared, radius, "")


def _without_path(error: Exception, run: RunFolder) -> str:
    return str(error).removeprefix(f"{run.path}: ")


@lru_cache(maxsize=1)
def open_shared(folder: Path, sha256: str) -> Dataset:
    """The data set in that folder: one in the memory of a worker, however many trainings it does.

    Raises:
        DatasetError: it is another one.
    """
    dataset = load_dataset(folder)
    if dataset.sha256 != sha256:
        raise DatasetError(
            f"{folder}: expected the data set {sha256:.16}…, found {dataset.sha256:.16}…. Share "
            f"one data folder between all workers, and leave it alone while they train."
        )
    return dataset


class _Stopwatch:
    """Time spent on a run since its begin, as of its last checkpoint where it was killed."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._before_s = 0.0
        if file.exists():
            self._before_s = float(json.loads(file.read_text(encoding="utf-8"))["training_s"])
        self._begun_s = time.monotonic()

    def keep(self) -> float:
        """The time so far, written down."""
        seconds = self._before_s + time.monotonic() - self._begun_s
        _write(self._file, {"training_s": seconds})
        return seconds


def _write(file: Path, fields: dict[str, Any]) -> None:
    part = file.with_name(file.name + ".part")
    part.write_text(json.dumps(fields, indent=2) + "\n", encoding="utf-8")
    os.replace(part, file)
