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
from dataclasses import dataclass
from datetime import datetime
from functools import lru_cache
from pathlib import Path

import numpy as np

from offline.campaign.attempt import Attempt
from offline.campaign.claim import claimed
from offline.campaign.result import Result, keep_result, read_result
from offline.campaign.score import assess, score
from offline.campaign.whole_file import write_json
from offline.checkpoint import load_checkpoint
from offline.config import TrainingConfig
from offline.dataset import Dataset, load_dataset
from offline.export import largest_radius_of
from offline.run_folder import LATEST_LINK, RunFolder, create_run, open_run
from offline.schedule import is_evaluated
from offline.train import Progress, TrainingDivergedError, train
from rt_controller.contract.errors import ConfigError, DatasetError

CPU_TIME_FILE = "cpu-time.json"

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
            keep_result(training.folder, result)
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
    watch = _Stopwatch(run.path / CPU_TIME_FILE)
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
        return Result("diverged", step, watch.keep(), str(error).removeprefix(f"{run.path}: "))
    cpu_s = watch.keep()
    if outcome.is_finished:
        return _judge(run, dataset, training, cpu_s)
    return None if go_on else Result("pruned", outcome.step, cpu_s)


def _judge(run: RunFolder, dataset: Dataset, training: Training, cpu_s: float) -> Result:
    checkpoint = load_checkpoint(run.best)
    found = assess(checkpoint, dataset)
    radius = found.spectral_radius
    may_drive = radius <= largest_radius_of(checkpoint.config)
    return Result(
        ending="finished" if may_drive else "refused",
        step=checkpoint.step,
        training_cpu_s=cpu_s,
        reason=""
        if may_drive
        else f"spectral radius {radius:.5f}, which offline-export would not let pass",
        score=score(found.errors, np.asarray(training.rivals)) if may_drive else None,
        spectral_radius=radius,
        n_parameters=found.n_parameters,
    )


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
    """CPU time spent on a run since its begin, as of its last checkpoint where it was killed."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._before_s = 0.0
        if file.exists():
            self._before_s = float(json.loads(file.read_text(encoding="utf-8"))["cpu_s"])
        self._begun_s = time.process_time()

    def keep(self) -> float:
        """The time so far, written down."""
        cpu_s = self._before_s + time.process_time() - self._begun_s
        write_json(self._file, {"cpu_s": cpu_s})
        return cpu_s
