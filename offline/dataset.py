"""The data set on disk: trajectories.npz, and a manifest that says what it is.

The manifest carries the recipe, the seed, the fingerprint of the car and the SHA-256 of every
number, so that a truncated, altered or foreign file is refused and never trained on. Data sets
live in a cache folder named after what they were made from.
"""

import hashlib
import json
import os
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from offline.excitation import Recipe
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.signals import (
    EXOGENOUS_FIELDS,
    EXOGENOUS_UNITS,
    INPUT_UNITS,
    STATE_UNITS,
    ControlInput,
    VehicleState,
)
from rt_controller.contract.timing import PERIOD_S

Array32 = NDArray[np.float32]
Part = Literal["train", "validation", "test"]

FORMAT_VERSION = 1
TRAJECTORIES_FILE = "trajectories.npz"
MANIFEST_FILE = "manifest.json"
PARTS: tuple[Part, ...] = ("train", "validation", "test")
HELD_BACK = 0.1
"""share of the episodes for validation, and the same again for the test"""

_EXPECTED = {
    "format_version": FORMAT_VERSION,
    "state_fields": list(VehicleState._fields),
    "state_units": list(STATE_UNITS),
    "input_fields": list(ControlInput._fields),
    "input_units": list(INPUT_UNITS),
    "exogenous_fields": list(EXOGENOUS_FIELDS),
    "exogenous_units": list(EXOGENOUS_UNITS),
    "dt_s": PERIOD_S,
}


class Trajectories(NamedTuple):
    """Slices of episodes, in physical units."""

    x: Array32
    """(N, K+1, 6) as `VehicleState`"""
    u: Array32
    """(N, K, 3) as `ControlInput`"""
    kappa: Array32
    """(N,) curvature in 1/m"""
    episode: NDArray[np.int32]
    """(N,) the number of the episode a slice was cut from"""

    def take(self, rows: NDArray[np.integer] | NDArray[np.bool_] | slice) -> "Trajectories":
        """The trajectories of these rows."""
        return Trajectories(self.x[rows], self.u[rows], self.kappa[rows], self.episode[rows])


@dataclass(frozen=True, slots=True)
class Dataset:
    """All trajectories, which part each belongs to, and where they came from."""

    trajectories: Trajectories
    part: NDArray[np.int8]
    """(N,) index into `PARTS`"""
    sha256: str
    manifest: Mapping[str, Any]

    def select(self, part: Part) -> Trajectories:
        """The trajectories of one part, in stored order."""
        return self.trajectories.take(self.part == PARTS.index(part))


def cache_folder(recipe: Recipe, episodes: int, seed: int, plant_fingerprint: str) -> Path:
    """Where the data set of this recipe lives: below $XDG_CACHE_HOME, else ~/.cache."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    origin = json.dumps(_origin(recipe, episodes, seed, plant_fingerprint), sort_keys=True)
    name = hashlib.sha256(origin.encode()).hexdigest()[:16]
    return base / "rt-controller" / "datasets" / f"{episodes}-episodes-{name}"


def split_by_episode(episode: NDArray[np.int32], seed: int) -> NDArray[np.int8]:
    """Part (N,) of each trajectory: all slices of one episode fall into the same part."""
    numbers = np.unique(episode)
    shuffled = np.random.default_rng([seed, len(numbers)]).permutation(numbers)
    held_back = round(HELD_BACK * len(numbers))
    part = np.full(len(episode), PARTS.index("train"), dtype=np.int8)
    part[np.isin(episode, shuffled[:held_back])] = PARTS.index("validation")
    part[np.isin(episode, shuffled[held_back : 2 * held_back])] = PARTS.index("test")
    return part


def save_dataset(
    folder: Path,
    trajectories: Trajectories,
    *,
    rejected: int,
    recipe: Recipe,
    seed: int,
    plant_fingerprint: str,
) -> Dataset:
    """Split, write and describe a data set; the manifest comes last and makes it valid."""
    episodes = len(np.unique(trajectories.episode))
    part = split_by_episode(trajectories.episode, seed)
    arrays: dict[str, Any] = {**trajectories._asdict(), "part": part}
    sha256 = _hash_arrays(arrays)
    manifest = {
        **_EXPECTED,
        "sha256": sha256,
        "trajectories": len(trajectories.kappa),
        "rejected_episodes": rejected,
        "rejected_fraction": rejected / (rejected + episodes),
        "versions": {name: version(name) for name in ("rt-controller", "numpy")},
        **_origin(recipe, episodes, seed, plant_fingerprint),
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        part_file = folder / (TRAJECTORIES_FILE + ".part")
        with part_file.open("wb") as file:
            np.savez(file, **arrays)
        os.replace(part_file, folder / TRAJECTORIES_FILE)
        part_file = folder / (MANIFEST_FILE + ".part")
        part_file.write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
        os.replace(part_file, folder / MANIFEST_FILE)
    except OSError as error:
        raise DatasetError(
            f"{folder}: expected a folder with room for a data set, found: {error.strerror}. "
            f"Choose another with --data."
        ) from error
    return Dataset(trajectories, part, sha256, manifest)


def exists(folder: Path) -> bool:
    """Whether a complete data set was once written there."""
    return (folder / MANIFEST_FILE).is_file()


def load_dataset(folder: Path) -> Dataset:
    """Read a data set and check that it is the one its manifest describes.

    Raises:
        DatasetError: a file is missing, truncated or altered, or the data set is of other
            signals, another period or another format.
    """
    manifest = _read_manifest(folder / MANIFEST_FILE)
    for key, expected in _EXPECTED.items():
        if manifest.get(key) != expected:
            raise DatasetError(
                f"{folder / MANIFEST_FILE}: expected {key} = {expected}, found "
                f"{manifest.get(key)}. Make the data set again with offline-data."
            )
    arrays = _read_arrays(folder / TRAJECTORIES_FILE)
    found = _hash_arrays(arrays)
    if found != manifest.get("sha256"):
        raise DatasetError(
            f"{folder / TRAJECTORIES_FILE}: expected numbers of SHA-256 "
            f"{str(manifest.get('sha256'))[:16]}…, found {found[:16]}…: the file was altered or "
            f"belongs to another manifest. Delete the folder and run offline-data again."
        )
    trajectories = Trajectories(*(arrays[name] for name in Trajectories._fields))
    _require_finite(folder / TRAJECTORIES_FILE, trajectories)
    return Dataset(trajectories, arrays["part"], found, manifest)


def _origin(recipe: Recipe, episodes: int, seed: int, plant_fingerprint: str) -> dict[str, Any]:
    """Everything the numbers follow from."""
    return {
        "recipe": json.loads(json.dumps(asdict(recipe))),
        "episodes": episodes,
        "seed": seed,
        "plant_fingerprint": plant_fingerprint,
    }


def _require_finite(path: Path, trajectories: Trajectories) -> None:
    columns = (("x", VehicleState._fields), ("u", ControlInput._fields))
    for name, fields in columns:
        array = getattr(trajectories, name)
        if not np.all(np.isfinite(array)):
            row, step, field = np.argwhere(~np.isfinite(array))[0]
            raise DatasetError(
                f"{path}: expected finite numbers, found {array[row, step, field]} for "
                f"{fields[field]} at step {step} of trajectory {row}. Remove that trajectory, or "
                f"make the data set again."
            )


def _hash_arrays(arrays: Mapping[str, NDArray[Any]]) -> str:
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(array.data)
    return digest.hexdigest()


def _read_manifest(path: Path) -> dict[str, Any]:
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise DatasetError(
            f"{path}: expected the manifest of a data set, found no such file. Make one with "
            f"offline-data, or point --data at its folder."
        ) from error
    except (OSError, ValueError) as error:
        raise DatasetError(
            f"{path}: expected a manifest in JSON, found something unreadable ({error}). Delete "
            f"the folder and run offline-data again."
        ) from error
    if not isinstance(manifest, dict):
        raise DatasetError(
            f"{path}: expected a JSON object, found {type(manifest).__name__}. Delete the folder "
            f"and run offline-data again."
        )
    return manifest


def _read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    names = (*Trajectories._fields, "part")
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in names}
    except FileNotFoundError as error:
        raise DatasetError(
            f"{path}: expected the trajectories of a data set, found no such file. Delete the "
            f"folder and run offline-data again."
        ) from error
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile) as error:
        raise DatasetError(
            f"{path}: expected an npz archive with {', '.join(names)}, found a truncated or "
            f"foreign file ({error}). Delete the folder and run offline-data again."
        ) from error
