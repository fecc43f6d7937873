"""The data set that all trainings of a campaign share, and the rival on it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offline.backend import Backend
from offline.baselines import roster
from offline.campaign.score import mean_squared_errors
from offline.config import TrainingConfig
from offline.dataset import Dataset, exists, load_dataset
from offline.judgement import LTI_RIVALS
from offline.rivals import rival_cache
from offline.stock import ensure_dataset
from offline.terminal import CONSOLE
from rt_controller.contract.errors import DatasetError

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class CampaignData:
    """A data set as far as a campaign has to know it."""

    folder: Path
    sha256: str
    states: tuple[str, ...]
    rivals: tuple[float, ...]
    """mean squared errors (n,) of the fair linear model on the validation part"""
    episodes: int
    seed: int

    def configure(self, config: TrainingConfig) -> TrainingConfig:
        """The configuration with the episodes and the seed of these data."""
        return config.model_copy(update={"episodes": self.episodes, "data_seed": self.seed})


def open_data(
    data: Path | None, config: TrainingConfig, chosen: TrainingConfig | None, backend: Backend
) -> CampaignData:
    """The data set in that folder; None: the one of the configuration, made now if need be.

    Raises:
        DatasetError: the folder holds other data than were explicitly asked for.
    """
    if data is not None and exists(data):
        folder, dataset = data, load_dataset(data)
    else:
        folder, dataset = ensure_dataset(data, config.episodes, config.data_seed, backend)
    origin = dataset.origin
    explicit = chosen.model_fields_set if chosen else set()
    for name, found in (("episodes", origin.episodes), ("data_seed", origin.seed)):
        if name in explicit and getattr(config, name) != found:
            raise DatasetError(
                f"{folder}: expected a data set of {name} = {getattr(config, name)}, found "
                f"{name} = {found}. Choose another --data."
            )
    with CONSOLE.status("fair linear model"):
        rivals = fair_linear_errors(dataset)
    return CampaignData(
        folder=folder,
        sha256=dataset.sha256,
        states=dataset.schema.state_names,
        rivals=tuple(float(error) for error in rivals),
        episodes=origin.episodes,
        seed=origin.seed,
    )


def fair_linear_errors(dataset: Dataset) -> Array:
    """Mean squared errors (n,) on the validation part: in each state the better linear model's.

    One model for all roads, and one for each where the data know roads, as `offline-evaluate` has
    it on the test part.
    """
    validation = dataset.select("validation")
    errors = [
        mean_squared_errors(roster.fit(name, dataset, rival_cache()), validation)
        for name in LTI_RIVALS
        if roster.find_objection(name, dataset) is None
    ]
    return np.asarray(np.min(errors, axis=0))
