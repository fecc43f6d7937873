"""Comparison of variants: each is trained with each seed on the same data."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from filelock import Timeout

from offline.data.tasks import run_tasks
from offline.experiments.backend import Backend
from offline.experiments.running_command import RunningCommand, running_command
from offline.experiments.table import Row
from offline.experiments.training_task import (
    LOCK_POLL_S,
    CampaignData,
    Result,
    Training,
    find_run,
    folder_lock,
    run_training,
)
from offline.experiments.variants import Variant


def compare(
    variants: Sequence[Variant],
    seeds: Sequence[int],
    data: CampaignData,
    folder: Path,
    backend: Backend,
    on_result: Callable[[int, Row, Result], None],
) -> tuple[Row, ...]:
    """One row for each variant and seed; without a result if it was stopped before its end.

    Finished trainings are not repeated; interrupted ones continue from their checkpoints.
    `on_result` is called with the number of ended trainings, the newest one and its result.

    Raises:
        ConfigError: the folder has trainings of other settings, or cannot be written.
        WorkersLostError: workers died repeatedly.
    """
    pairs = [(variant, seed) for variant in variants for seed in seeds]
    trainings = []
    for variant, seed in pairs:
        config = variant.config.model_copy(update={"seed": seed})
        training = Training(folder.resolve() / variant.name / f"seed-{seed}", config, data)
        find_run(training)
        trainings.append(training)
    rows = [Row(variant, seed, None) for variant, seed in pairs]
    with backend.active(), running_command(folder) as command:
        for index, result in run_tasks(train_locked, [(each, command) for each in trainings]):
            if result is not None:
                rows[index] = replace(rows[index], result=result)
                on_result(sum(row.result is not None for row in rows), rows[index], result)
    return tuple(rows)


def train_locked(training: Training, command: RunningCommand) -> Result | None:
    """The result of a training; waits while another command trains in its folder. None: stopped."""
    command.leave_ctrl_c_to_it()
    if command.is_stopped():
        return None
    training.folder.mkdir(parents=True, exist_ok=True)
    try:
        with folder_lock(training.folder).acquire(
            poll_interval=LOCK_POLL_S, cancel_check=command.is_stopped
        ):
            return run_training(training, command)
    except Timeout:
        return None
