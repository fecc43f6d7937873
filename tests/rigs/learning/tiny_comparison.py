"""A comparison of two small variants without a command line, and what its folder shows."""

from pathlib import Path

from offline.config import TrainingConfig
from offline.experiments import comparison
from offline.experiments.backend import Backend
from offline.experiments.comparison import Row, Training, read_variants
from offline.experiments.settings import common_fields
from offline.experiments.training_task import CampaignData

OF_THE_TOY = {"episodes": 40, "data_seed": 3}


def tiny_trainings(lists: Path, **changes: object) -> tuple[Training, ...]:
    """The list `tiny` for the toy data set."""
    common = common_fields(TrainingConfig.model_validate({**OF_THE_TOY, **changes}), {})
    return read_variants("tiny", lists, common)[1]


def compare(
    lists: Path,
    shared: CampaignData,
    folder: Path,
    backend: Backend,
    seeds: tuple[int, ...] = (0, 1),
    **changes: object,
) -> list[Row]:
    """A row for each training."""
    trainings = [
        each._replace(config=each.config.model_copy(update={"seed": seed}))
        for each in tiny_trainings(lists, **changes)
        for seed in seeds
    ]
    return comparison.compare(trainings, shared, folder, backend, lambda *ended: None)


def histories(folder: Path) -> dict[str, bytes]:
    """History file of each training, by its path."""
    found = folder.glob("*/seed-*/latest/history.jsonl")
    return {str(file.relative_to(folder)): file.read_bytes() for file in found}


def runs(folder: Path) -> list[int]:
    """Number of runs that were started in the folder of each training."""
    return [len(list(training.glob("*-recommended"))) for training in folder.glob("*/seed-*")]
