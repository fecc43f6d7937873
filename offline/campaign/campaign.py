"""Many trainings, given out and gathered."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from offline.backend import Backend
from offline.campaign.attempt import attempt
from offline.campaign.trainings import Result, Training, find_run, run_training
from offline.parallel import as_done


def run_campaign(
    folder: Path,
    trainings: Sequence[Training],
    backend: Backend,
    on_end: Callable[[int, Result], None],
) -> dict[int, Result]:
    """Results by number of the training; those that were stopped before their end are missing.

    `on_end` hears of each training that ended, finished earlier or now. What has ended is not
    done again, what was interrupted goes on from its checkpoint.

    Raises:
        ConfigError: a folder holds a training of another configuration or data set.
        WorkersLostError: workers died again and again.
    """
    for training in trainings:
        find_run(training)
    results: dict[int, Result] = {}
    with backend.active(), attempt(folder) as current:
        tasks = [(training, current, os.getpid()) for training in trainings]
        for number, result in as_done(run_training, tasks):
            if result is not None:
                results[number] = result
                on_end(number, result)
    return results
