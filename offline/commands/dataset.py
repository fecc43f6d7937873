"""The data set of a command: loaded from its folder, or made now with a progress bar."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from offline.commands.terminal import STDERR, progress_bar, stop_on_signals
from offline.config import TrainingConfig, explicit_fields
from offline.data.dataset import Dataset, cache_folder, exists, load_dataset
from offline.data.generate import make_dataset, simulated_origin
from offline.data.manifest import Imported, Origin, Simulated
from offline.data.recipe import Recipe
from rt_controller.contract.errors import DatasetError
from rt_controller.terminal.entry import interrupt
from sim_bridge.campaign import Backend


def ensure_dataset(
    data: Path | None, config: TrainingConfig, backend: Backend
) -> tuple[Path, Dataset]:
    """Folder and content of a named data set, or of the nominal one of this length in the cache.

    The one in the cache is made by that backend if it does not exist; a named one is loaded
    whatever its number of episodes.

    Raises:
        DatasetError: a named one does not exist.
    """
    if data is not None:
        return data, load_dataset(data)
    recipe = Recipe(largest_steer_deg=config.largest_steer_deg)
    return find_or_make(None, config.episodes, config.data_seed, recipe, backend)


def find_or_make(
    data: Path | None, episodes: int, seed: int, recipe: Recipe, backend: Backend
) -> tuple[Path, Dataset]:
    """The data set in the named folder, or the one of that recipe; made now if there is none."""
    if data is not None and exists(data):
        return data, load_dataset(data)
    origin = simulated_origin(recipe, episodes, seed)
    folder = data or cache_folder(origin)
    if exists(folder):
        return folder, load_dataset(folder)
    STDERR.print(f"making a data set of {episodes} episodes in {folder}", soft_wrap=True)
    with stop_on_signals(interrupt), progress_bar("simulating", episodes) as show:
        return folder, make_dataset(
            folder, origin, backend=backend, on_progress=lambda done: show(done, "")
        )


def require_origin(
    folder: Path, origin: Origin, episodes: int, seed: int, recipe: Recipe | None = None
) -> None:
    """Return if a simulated data set has that many episodes of that seed, and of that recipe.

    Imports always pass; None: any recipe.

    Raises:
        DatasetError: it has not.
    """
    if isinstance(origin, Imported):
        return
    if (origin.episodes, origin.seed) != (episodes, seed):
        raise DatasetError(
            f"{folder}: expected {episodes} episodes of seed {seed}, found a data set of "
            f"{origin.episodes} episodes of seed {origin.seed}. Choose another --data."
        )
    if recipe is not None and origin.recipe.text != recipe.text:
        raise DatasetError(
            f"{folder}: expected a data set drawn with {recipe.text}, found one drawn with "
            f"{origin.recipe.text}. Choose another --data."
        )


def config_of_data(
    folder: Path, origin: Origin, config: TrainingConfig, chosen: TrainingConfig | None
) -> TrainingConfig:
    """The configuration with the episodes and the seed of the data set in that folder.

    Raises:
        DatasetError: the options explicitly chose other values.
    """
    explicit = explicit_fields(chosen)
    of_data: dict[str, Any] = {"episodes": origin.episodes, "data_seed": origin.seed}
    recipe = None
    if isinstance(origin, Simulated):
        of_data["largest_steer_deg"] = origin.recipe.largest_steer_deg
        if "largest_steer_deg" in explicit:
            recipe = replace(origin.recipe, largest_steer_deg=explicit["largest_steer_deg"])
    asked = {**of_data, **{name: explicit[name] for name in of_data if name in explicit}}
    require_origin(folder, origin, asked["episodes"], asked["data_seed"], recipe)
    return config.model_copy(update=of_data)
