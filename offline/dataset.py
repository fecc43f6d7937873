"""The data set on disk: recording.npz, and a manifest that says what it is.

The manifest carries the signals, the recipe or the logs, and the SHA-256 of every number and of
what it means, so that a truncated, altered or foreign file is refused and never trained on. Data
sets of the simulated car live in a cache folder named after what they were made from.

A data set is whole drives and a list of slices of them. The slices are the paper's trajectories,
the same for everybody who validates and tests; a model may learn from any window of the drives.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from offline.manifest import Imported, Manifest, Origin, Roads, read_manifest
from offline.recording import PATH_STATES, Recording, Starts, cut
from offline.road_frame import Anchor
from offline.roles import Roles
from offline.trajectories import Trajectories
from rt_controller.contract.archive import DamagedArchiveError, read_arrays
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.schema import Schema

Part = Literal["train", "validation", "test"]

RECORDING_FILE = "recording.npz"
MANIFEST_FILE = "manifest.json"
PARTS: tuple[Part, ...] = ("train", "validation", "test")
HELD_BACK = 0.1
"""share of the episodes for validation, and the same again for the test"""

_ARRAYS = (
    *Recording._fields,
    "part",
    "slice_row",
    "slice_episode",
    *(f"slice_{n}" for n in Anchor._fields),
)


@dataclass(frozen=True, slots=True)
class Dataset:
    """Drives, the slices of them, which part each belongs to, and where they came from."""

    recording: Recording
    slices: Starts
    part: NDArray[np.int8]
    """(E,) of each episode, index into `PARTS`"""
    manifest: Manifest

    @property
    def sha256(self) -> str:
        """Hash of all numbers and their meaning, which is what the data set is known by."""
        return self.manifest.sha256

    @property
    def origin(self) -> Origin:
        return self.manifest.origin

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


def cache() -> Path:
    """The folder of all data sets: below $XDG_CACHE_HOME, else ~/.cache."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "rt-controller" / "datasets"


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
    rejected: int = 0,
) -> Dataset:
    """Write and describe a data set; the manifest comes last and makes it valid.

    Raises:
        DatasetError: a number is not finite, or the folder has no room.
    """
    _require_fitting(folder / RECORDING_FILE, recording, slices, schema, roads)
    _require_finite(folder / RECORDING_FILE, recording, slices, schema)
    anchor = slices.anchor or Anchor(*(np.zeros(0) for _ in Anchor._fields))
    arrays: dict[str, NDArray[Any]] = {
        **recording._asdict(),
        "part": part,
        "slice_row": slices.row,
        "slice_episode": slices.episode,
        **{f"slice_{name}": column for name, column in anchor._asdict().items()},
    }
    manifest = Manifest(
        schema=schema,
        roles=roles,
        roads=roads,
        sha256=_hash(arrays, schema, roles, roads),
        trajectories=len(slices.row),
        rejected_episodes=rejected,
        versions={name: version(name) for name in ("rt-controller", "numpy")},
        origin=origin,
    )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        mark = f".{uuid4().hex}.part"  # two processes may make the same data set at once
        part_file = folder / (RECORDING_FILE + mark)
        with part_file.open("wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]
        os.replace(part_file, folder / RECORDING_FILE)
        part_file = folder / (MANIFEST_FILE + mark)
        part_file.write_text(manifest.to_json(), encoding="utf-8")
        os.replace(part_file, folder / MANIFEST_FILE)
    except OSError as error:
        raise DatasetError(
            f"{folder}: expected a folder with room for a data set, found: {error.strerror}. "
            f"Choose another with --data."
        ) from error
    return Dataset(recording, slices, part, manifest)


def exists(folder: Path) -> bool:
    """Whether a complete data set was once written there."""
    return (folder / MANIFEST_FILE).is_file()


def load_dataset(folder: Path) -> Dataset:
    """Read a data set and check that it is the one its manifest describes.

    Raises:
        DatasetError: a file is missing, truncated or altered, or of another format.
    """
    manifest = read_manifest(folder / MANIFEST_FILE)
    path = folder / RECORDING_FILE
    remedy = _remedy(manifest.origin)
    arrays = _read_arrays(path, remedy)
    found = _hash(arrays, manifest.schema, manifest.roles, manifest.roads)
    if found != manifest.sha256:
        raise DatasetError(
            f"{path}: expected numbers of SHA-256 {manifest.sha256:.16}…, found {found:.16}…: the "
            f"file or its manifest was altered, or they are not of one data set. {remedy}"
        )
    recording = Recording(*(arrays[name] for name in Recording._fields))
    anchor = Anchor(*(arrays[f"slice_{name}"] for name in Anchor._fields))
    slices = Starts(
        arrays["slice_row"],
        arrays["slice_episode"],
        anchor if len(anchor.ey_m) == len(arrays["slice_row"]) else None,
    )
    _require_fitting(path, recording, slices, manifest.schema, manifest.roads)
    _require_finite(path, recording, slices, manifest.schema)
    return Dataset(recording, slices, arrays["part"], manifest)


def _remedy(origin: Origin) -> str:
    command = "offline-import" if isinstance(origin, Imported) else "offline-data"
    return f"Delete the folder and run {command} again."


def _require_fitting(
    path: Path, recording: Recording, slices: Starts, schema: Schema, roads: Roads | None
) -> None:
    """Return if arrays hold the schema's signals, and poses just where roads may be laid."""
    path_states = len(PATH_STATES) if recording.has_poses else 0
    expected = (
        len(schema.states) - path_states,
        len(schema.inputs),
        len(schema.exogenous),
        roads is not None,
        roads is not None,
    )
    found = (
        recording.x.shape[1],
        recording.u.shape[1],
        recording.w.shape[1],
        recording.has_poses,
        slices.anchor is not None,
    )
    if expected != found:
        raise DatasetError(
            f"{path}: expected {expected[0]} recorded states, {expected[1]} inputs, {expected[2]} "
            f"exogenous signals, poses: {expected[3]}, slices on roads: {expected[4]}, found "
            f"{', '.join(str(part) for part in found)}. Manifest and recording are not of one data "
            f"set: make it again."
        )


def _require_finite(path: Path, recording: Recording, slices: Starts, schema: Schema) -> None:
    columns = (
        (recording.x, schema.state_names),
        (recording.u, schema.input_names),
        (recording.w, schema.exogenous_names),
        (recording.pose, ("X_m", "Y_m", "yaw_rad")),
    )
    for array, names in columns:
        if not np.all(np.isfinite(array)):
            row, column = np.argwhere(~np.isfinite(array))[0]
            episode = int(np.searchsorted(recording.first, row, side="right")) - 1
            raise DatasetError(
                f"{path}: expected finite numbers, found {array[row, column]} for "
                f"{names[column]} at sample {row - recording.first[episode]} of episode "
                f"{episode}. Leave that episode out, or make the data set again."
            )

    for name, column in (slices.anchor or Anchor(*[np.zeros(0)] * 3))._asdict().items():
        if not np.all(np.isfinite(column)):
            row = int(np.argmax(~np.isfinite(column)))
            raise DatasetError(
                f"{path}: expected finite numbers, found {column[row]} for {name} of slice {row}. "
                f"Leave that slice out, or make the data set again."
            )


def _hash(
    arrays: Mapping[str, NDArray[Any]], schema: Schema, roles: Roles, roads: Roads | None
) -> str:
    """SHA-256 of the numbers, their signals, and what the learning may assume of them."""
    meaning = [asdict(schema), asdict(roles), asdict(roads) if roads else None]
    digest = hashlib.sha256(json.dumps(meaning, sort_keys=True).encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(array.data)
    return digest.hexdigest()


def _read_arrays(path: Path, remedy: str) -> dict[str, NDArray[Any]]:
    try:
        arrays = read_arrays(path)
    except FileNotFoundError as error:
        raise DatasetError(
            f"{path}: expected the recording of a data set, found no such file. {remedy}"
        ) from error
    except (OSError, DamagedArchiveError) as error:
        raise DatasetError(
            f"{path}: expected an npz archive with {', '.join(_ARRAYS)}, found a truncated or "
            f"foreign file ({error}). {remedy}"
        ) from error
    if set(arrays) != set(_ARRAYS):
        raise DatasetError(
            f"{path}: expected the arrays {', '.join(_ARRAYS)}, found "
            f"{', '.join(sorted(arrays))}. {remedy}"
        )
    return arrays
