"""The data sets at hand: in a folder, in the cache, or made now."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offline.backend import Backend
from offline.config import PRESETS
from offline.dataset import (
    MANIFEST_FILE,
    Dataset,
    cache,
    exists,
    load_dataset,
    save_dataset,
    split_episodes,
)
from offline.excitation import Recipe
from offline.generate import FIRST_EPSI_RAD, FIRST_EY_M, Generated, generate, plant_fingerprint
from offline.manifest import Driven, Roads, read_manifest
from offline.roles import VEHICLE_ROLES
from offline.terminal import CONSOLE, progress_bar
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.schema import VEHICLE


def ensure_dataset(
    data: Path | None, episodes: int, seed: int, backend: Backend
) -> tuple[Path, Dataset]:
    """Folder and content of a data set, made now, by that backend, if it is not there.

    A folder that holds one already is taken as it is, of however many episodes.
    """
    origin = origin_today(episodes, seed)
    folder = data or cache() / origin.name
    if exists(folder):
        return folder, load_dataset(folder)
    CONSOLE.print(f"making a data set of {episodes} episodes in {folder}", soft_wrap=True)
    done = 0
    with backend.active(), progress_bar("driving", episodes) as show:

        def on_progress(more: int) -> None:
            nonlocal done
            done += more
            show(done, "")

        made = generate(origin.recipe, episodes, seed, None, on_progress)
    return folder, keep(folder, made, split_episodes(episodes, seed), origin)


def keep(folder: Path, made: Generated, part: NDArray[np.int8], origin: Driven) -> Dataset:
    """Drives of the simulated car as a data set in that folder; part (E,) as in `Dataset`.

    Raises:
        DatasetError: the folder has no room.
    """
    return save_dataset(
        folder,
        made.recording,
        made.slices,
        part,
        schema=VEHICLE,
        roles=VEHICLE_ROLES,
        roads=Roads(origin.recipe.curvatures_per_m, FIRST_EY_M, FIRST_EPSI_RAD),
        origin=origin,
        rejected=made.rejected,
    )


def full_folder() -> Path:
    """Where the paper's data set lives, of today's recipe and car."""
    paper = PRESETS["paper"]
    return cache() / origin_today(paper.episodes, paper.data_seed).name


def find_dataset(sha256: str) -> Path | None:
    """The folder in the cache whose numbers have this hash."""
    for manifest in sorted(cache().glob(f"*/{MANIFEST_FILE}")):
        try:
            if read_manifest(manifest).sha256 == sha256:
                return manifest.parent
        except DatasetError:
            continue  # damaged, or of another version: not the one
    return None


def origin_today(episodes: int, seed: int) -> Driven:
    """What a data set made now would follow from."""
    with CONSOLE.status("compiling the car"):
        fingerprint = plant_fingerprint()
    return Driven(Recipe(), episodes, seed, fingerprint)
