"""The data set on disk: trajectories.npz, and a manifest that says what it is.

The manifest carries the recipe, the seed, the fingerprint of the car and the SHA-256 of every
number, so that a truncated, altered or foreign file is refused and never trained on. Data sets
live in a cache folder named after what they were made from.
"""

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from offline.manifest import Manifest, Origin, read_manifest
from rt_controller.contract.archive import DamagedArchiveError, read_arrays
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.signals import ControlInput, VehicleState

Array32 = NDArray[np.float32]
Part = Literal["train", "validation", "test"]

TRAJECTORIES_FILE = "trajectories.npz"
MANIFEST_FILE = "manifest.json"
PARTS: tuple[Part, ...] = ("train", "validation", "test")
HELD_BACK = 0.1
"""share of the episodes for validation, and the same again for the test"""


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
    manifest: Manifest

    @property
    def sha256(self) -> str:
        """Hash of all numbers, which is what the data set is known by."""
        return self.manifest.sha256

    @property
    def origin(self) -> Origin:
        return self.manifest.origin

    def select(self, part: Part) -> Trajectories:
        """The trajectories of one part, in stored order."""
        return self.trajectories.take(self.part == PARTS.index(part))


def cache() -> Path:
    """The folder of all data sets: below $XDG_CACHE_HOME, else ~/.cache."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "rt-controller" / "datasets"


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
    folder: Path, trajectories: Trajectories, *, rejected: int, origin: Origin
) -> Dataset:
    """Split, write and describe a data set; the manifest comes last and makes it valid."""
    part = split_by_episode(trajectories.episode, origin.seed)
    arrays: dict[str, Any] = {**trajectories._asdict(), "part": part}
    manifest = Manifest(
        sha256=_hash_arrays(arrays),
        trajectories=len(trajectories.kappa),
        rejected_episodes=rejected,
        versions={name: version(name) for name in ("rt-controller", "numpy")},
        origin=origin,
    )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        part_file = folder / (TRAJECTORIES_FILE + ".part")
        with part_file.open("wb") as file:
            np.savez(file, **arrays)
        os.replace(part_file, folder / TRAJECTORIES_FILE)
        part_file = folder / (MANIFEST_FILE + ".part")
        part_file.write_text(manifest.to_json(), encoding="utf-8")
        os.replace(part_file, folder / MANIFEST_FILE)
    except OSError as error:
        raise DatasetError(
            f"{folder}: expected a folder with room for a data set, found: {error.strerror}. "
            f"Choose another with --data."
        ) from error
    return Dataset(trajectories, part, manifest)


def exists(folder: Path) -> bool:
    """Whether a complete data set was once written there."""
    return (folder / MANIFEST_FILE).is_file()


def load_dataset(folder: Path) -> Dataset:
    """Read a data set and check that it is the one its manifest describes.

    Raises:
        DatasetError: a file is missing, truncated or altered, or the data set is of other
            signals, another period or another format.
    """
    manifest = read_manifest(folder / MANIFEST_FILE)
    arrays = _read_arrays(folder / TRAJECTORIES_FILE)
    found = _hash_arrays(arrays)
    if found != manifest.sha256:
        raise DatasetError(
            f"{folder / TRAJECTORIES_FILE}: expected numbers of SHA-256 {manifest.sha256:.16}…, "
            f"found {found:.16}…: the file was altered or belongs to another manifest. Delete the "
            f"folder and run offline-data again."
        )
    trajectories = Trajectories(*(arrays[name] for name in Trajectories._fields))
    _require_finite(folder / TRAJECTORIES_FILE, trajectories)
    return Dataset(trajectories, arrays["part"], manifest)


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


def _read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    names = (*Trajectories._fields, "part")
    try:
        arrays = read_arrays(path)
    except FileNotFoundError as error:
        raise DatasetError(
            f"{path}: expected the trajectories of a data set, found no such file. Delete the "
            f"folder and run offline-data again."
        ) from error
    except (OSError, DamagedArchiveError) as error:
        raise DatasetError(
            f"{path}: expected an npz archive with {', '.join(names)}, found a truncated or "
            f"foreign file ({error}). Delete the folder and run offline-data again."
        ) from error
    if set(arrays) != set(names):
        raise DatasetError(
            f"{path}: expected the arrays {', '.join(names)}, found {', '.join(sorted(arrays))}. "
            f"Delete the folder and run offline-data again."
        )
    return arrays
