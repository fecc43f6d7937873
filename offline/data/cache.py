"""The cache of data sets of the simulated car, in folders named after what they follow from."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np
from numpy.typing import NDArray

from offline.config import PRESETS
from offline.data.conditions import CONDITIONS
from offline.data.dataset import MANIFEST_FILE, Dataset, save_dataset, split_episodes
from offline.data.excitation import Recipe
from offline.data.generate import (
    FIRST_EPSI_RAD,
    FIRST_EY_M,
    generate,
    plant_fingerprint,
    steering_geometry,
)
from offline.data.manifest import Roads, Simulated, read_manifest
from offline.data.signals import VEHICLE_ROLES
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.signals import VEHICLE

EPISODE_BYTES = 22_100
"""on disk, of an episode of 10 s"""
CONDITIONS_BYTES = 15_200
"""of its conditions"""


def cache() -> Path:
    """The folder of all data sets: below $XDG_CACHE_HOME, otherwise below ~/.cache.

    Raises:
        DatasetError: there is neither.
    """
    try:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError as error:
        raise DatasetError(
            "Expected a folder for data sets, found neither XDG_CACHE_HOME nor a home of this "
            "user. Set one of them, or name a folder with --data."
        ) from error
    return base / "rt-controller" / "datasets"


def cache_folder(origin: Simulated) -> Path:
    """The folder of the data set of that origin."""
    return cache() / origin.name


def simulated_origin(recipe: Recipe, episodes: int, seed: int) -> Simulated:
    """The origin of a data set made now; compiles the vehicle model."""
    return Simulated(recipe, episodes, seed, plant_fingerprint(recipe.variation))


def full_folder() -> Path:
    """The folder of the paper's data set, of the current recipe and car."""
    paper = PRESETS["paper"]
    return cache_folder(simulated_origin(Recipe(), paper.episodes, paper.data_seed))


def find_dataset(sha256: str) -> Path | None:
    """The folder in the cache whose data set has this digest; None if there is none."""
    for manifest in sorted(cache().glob(f"*/{MANIFEST_FILE}")):
        try:
            if read_manifest(manifest).sha256 == sha256:
                return manifest.parent
        except DatasetError:
            continue  # damaged, or of another version
    return None


def require_room(folder: Path, needed_bytes: int) -> None:
    """Return if files of this size can be written to a folder, which is made.

    Raises:
        DatasetError: they cannot.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            pass
        free_bytes = shutil.disk_usage(folder).free
    except OSError as error:
        found = str(error.strerror)
    else:
        if free_bytes >= needed_bytes:
            return
        found = f"{free_bytes / 1e6:.1f} MB where {needed_bytes / 1e6:.1f} MB are needed"
    raise DatasetError(
        f"{folder}: expected a folder with room for a data set, found: {found}. Choose another "
        f"with --data."
    )


def make_dataset(
    folder: Path,
    origin: Simulated,
    part: NDArray[np.int8] | None = None,
    jobs: int | None = None,
    on_progress: Callable[[int], None] = lambda done: None,
) -> Dataset:
    """A new data set of simulated episodes in that folder.

    Args:
        folder: where it is written.
        origin: what it is made from.
        part: (E,) part of each episode, as in `Dataset`; None: drawn at random.
        jobs: number of processes; None: the active joblib backend.
        on_progress: called with the number of episodes made so far, also by an earlier call that
            was interrupted: what it made is kept beside the folder.

    Raises:
        DatasetError: the folder has no room; as far as possible raised before the simulation.
    """
    recipe, episodes, seed = origin.recipe, origin.episodes, origin.seed
    is_varied = recipe.variation is not None
    require_room(folder, episodes * (EPISODE_BYTES + is_varied * CONDITIONS_BYTES))
    parts = folder.with_name(f".{origin.name}")
    parts.mkdir(parents=True, exist_ok=True)
    made = generate(recipe, episodes, seed, jobs, on_progress, parts)
    dataset = save_dataset(
        folder,
        made.recording,
        made.slices,
        split_episodes(episodes, seed) if part is None else part,
        schema=VEHICLE,
        roles=VEHICLE_ROLES,
        roads=Roads(recipe.curvatures_per_m, FIRST_EY_M, FIRST_EPSI_RAD),
        origin=origin,
        geometry=steering_geometry(),
        conditions=() if made.recording.conditions is None else CONDITIONS,
        rejected=made.rejected,
        rejected_by_friction=made.rejected_by_friction,
    )
    shutil.rmtree(parts, ignore_errors=True)
    return dataset
