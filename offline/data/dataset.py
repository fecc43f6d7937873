"""The data set: whole episodes, the slices of them, and which part each episode belongs to.

On disk: recording.npz, and manifest.json with signals, origin and the SHA-256 of all numbers. Those
of the simulated car are in the cache, where they are found by their origin.

Slices are the paper's trajectories, on which every model is validated and tested. A model may
learn from any window of the training episodes.

Two simulated data sets of one seed but different lengths share episodes and split them
differently, so one may train on what the other tests on. With equal seed and length the split is
the same; with different seeds no episode is shared. Both hold whatever the recipes vary.
"""

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from offline.data.manifest import (
    HELD_BACK,
    MANIFEST_FILE,
    PARTS,
    RECORDING_FILE,
    Imported,
    Manifest,
    Origin,
    Part,
    Roads,
    Simulated,
    read_manifest,
)
from offline.data.recording import Anchor, Recording, Starts, cut
from offline.data.signals import Roles, Trajectories
from rt_controller.contract.car import Car, car_of
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.files import DamagedArchiveError, atomic_write, read_arrays, write_text
from rt_controller.contract.signals import Schema

_SLICE_ARRAYS = ("slice_row", "slice_episode", *(f"slice_{name}" for name in Anchor._fields))


@dataclass(frozen=True, slots=True)
class Dataset:
    """Episodes, slices and parts, with the manifest."""

    recording: Recording
    slices: Starts
    part: NDArray[np.int8]
    """(E,) of each episode, index into `PARTS`"""
    manifest: Manifest

    @property
    def sha256(self) -> str:
        """Digest of all numbers and their meaning, which identifies the data set."""
        return self.manifest.sha256

    @property
    def origin(self) -> Origin:
        return self.manifest.origin

    @property
    def car(self) -> Car | None:
        """That the data is of; None: not known."""
        geometry = self.manifest.geometry
        if geometry is None:
            return None
        return car_of({**geometry._asdict(), **self.manifest.car})

    @property
    def schema(self) -> Schema:
        return self.manifest.schema

    @property
    def roles(self) -> Roles:
        return self.manifest.roles

    def episodes(self, part: Part) -> NDArray[np.int64]:
        """Numbers of the episodes of one part."""
        return np.flatnonzero(self.part == PARTS.index(part))

    def select(self, part: Part) -> Trajectories:
        """The slices of one part, in stored order."""
        chosen = self.part[self.slices.episode] == PARTS.index(part)
        return cut(self.recording, self.slices.take(chosen), self.schema, self.roles)


def split_episodes(episodes: int, seed: int) -> NDArray[np.int8]:
    """Part (E,) of each episode, drawn at random."""
    shuffled = np.random.default_rng([seed, episodes]).permutation(episodes)
    held_back = max(1, round(HELD_BACK * episodes)) if episodes >= len(PARTS) else 0
    part = np.full(episodes, PARTS.index("train"), dtype=np.int8)
    part[shuffled[:held_back]] = PARTS.index("validation")
    part[shuffled[held_back : 2 * held_back]] = PARTS.index("test")
    return part


def save_dataset(
    folder: Path,
    recording: Recording,
    slices: Starts,
    part: NDArray[np.int8],
    *,
    schema: Schema,
    roles: Roles,
    roads: Roads | None,
    origin: Origin,
    car: Car | None = None,
    conditions: tuple[str, ...] = (),
    rejected: int = 0,
) -> Dataset:
    """Write a data set; the manifest is written last and makes it valid.

    Raises:
        DatasetError: a number is not finite, or the folder has no room.
    """
    anchor = slices.anchor or Anchor(*(np.zeros(0) for _ in Anchor._fields))
    arrays: dict[str, NDArray[Any]] = {
        **{name: array for name, array in recording._asdict().items() if array is not None},
        "part": part,
        **dict(zip(_SLICE_ARRAYS, (slices.row, slices.episode, *anchor), strict=True)),
    }
    manifest = Manifest(
        schema=schema,
        roles=roles,
        roads=roads,
        sha256=_digest(arrays, schema, roles, roads, conditions),
        trajectories=len(slices.row),
        rejected_episodes=rejected,
        versions={name: version(name) for name in ("rt-controller", "numpy")},
        origin=origin,
        geometry=car.geometry if car else None,
        conditions=conditions,
        car=car.own_values if car else {},
    )
    _require_finite(folder / RECORDING_FILE, arrays)
    with writable(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with atomic_write(folder / RECORDING_FILE) as stream:
            np.savez(stream, **arrays)  # type: ignore[arg-type]
        write_text(folder / MANIFEST_FILE, manifest.to_json())
    return Dataset(recording, slices, part, manifest)


@contextmanager
def writable(folder: Path) -> Iterator[None]:
    """Context in which a failure to write becomes a `DatasetError` about the folder."""
    try:
        yield
    except OSError as error:
        raise DatasetError(
            f"{folder}: expected a folder with room for a data set, found: {error.strerror}. "
            f"Choose another with --data."
        ) from error


def exists(folder: Path) -> bool:
    """True if a complete data set was written there."""
    return (folder / MANIFEST_FILE).is_file()


def load_dataset(folder: Path) -> Dataset:
    """Read a data set and compare it with its manifest.

    Raises:
        DatasetError: a file is missing, truncated or altered, or of another format.
    """
    manifest = read_manifest(folder / MANIFEST_FILE)
    path = folder / RECORDING_FILE
    command = "offline-import" if isinstance(manifest.origin, Imported) else "offline-data"
    remedy = f"Delete the folder and run {command} again."
    names = [*Recording._fields, "part", *_SLICE_ARRAYS]
    if not manifest.conditions:
        names.remove("conditions")
    try:
        arrays = read_arrays(path)
    except FileNotFoundError as error:
        raise DatasetError(
            f"{path}: expected the recording of a data set, found no such file. {remedy}"
        ) from error
    except (OSError, DamagedArchiveError) as error:
        raise DatasetError(
            f"{path}: expected an npz archive with {', '.join(names)}, found a truncated or "
            f"foreign file ({error}). {remedy}"
        ) from error
    if set(arrays) != set(names):
        raise DatasetError(
            f"{path}: expected the arrays {', '.join(names)}, found "
            f"{', '.join(sorted(arrays))}. {remedy}"
        )
    found = _digest(arrays, manifest.schema, manifest.roles, manifest.roads, manifest.conditions)
    if found != manifest.sha256:
        raise DatasetError(
            f"{path}: expected numbers of SHA-256 {manifest.sha256:.16}…, found {found:.16}…: the "
            f"file or its manifest was altered, or they are not of one data set. {remedy}"
        )
    row, episode, *columns = (arrays[name] for name in _SLICE_ARRAYS)
    anchor = Anchor(*columns)
    return Dataset(
        Recording(**{name: arrays[name] for name in Recording._fields if name in arrays}),
        Starts(row, episode, anchor if len(anchor.ey_m) == len(row) else None),
        arrays["part"],
        manifest,
    )


def _digest(
    arrays: Mapping[str, NDArray[Any]],
    schema: Schema,
    roles: Roles,
    roads: Roads | None,
    conditions: tuple[str, ...],
) -> str:
    """SHA-256 of the arrays, the schema, the roles, the roads and the names of the conditions."""
    meaning: list[Any] = [asdict(schema), asdict(roles), asdict(roads) if roads else None]
    meaning += [conditions] if conditions else []
    digest = hashlib.sha256(json.dumps(meaning, sort_keys=True).encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(array.data)
    return digest.hexdigest()


def _require_finite(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    for name, array in arrays.items():
        rows = np.argwhere(~np.isfinite(array))
        if len(rows):
            raise DatasetError(
                f"{path}: expected finite numbers, found {array[tuple(rows[0])]} in row "
                f"{rows[0][0]} of {name}. Leave that drive out, or make the data set again."
            )


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
    """The folder in the cache that has the data set of that origin, or a new one for it."""
    found = _find_in_cache(lambda manifest: manifest.origin == origin)
    return found or cache() / origin.name


def find_dataset(sha256: str) -> Path | None:
    """The folder in the cache whose data set has this digest; None if there is none."""
    return _find_in_cache(lambda manifest: manifest.sha256 == sha256)


def _find_in_cache(is_wanted: Callable[[Manifest], bool]) -> Path | None:
    for manifest in sorted(cache().glob(f"*/{MANIFEST_FILE}")):
        with suppress(DatasetError):  # damaged, or of another version
            if is_wanted(read_manifest(manifest)):
                return manifest.parent
    return None
