"""The data set that all trainings of a campaign share, and the rival on it."""

from dataclasses import dataclass
from pathlib import Path

from offline.backend import Backend
from offline.campaign.rival import fair_linear_errors
from offline.config import TrainingConfig
from offline.dataset import exists, load_dataset
from offline.stock import ensure_dataset
from offline.terminal import CONSOLE
from rt_controller.contract.errors import DatasetError


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
