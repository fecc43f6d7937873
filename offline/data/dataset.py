"""The data set: whole episodes, the slices of them, and which part each episode belongs to.

On disk: recording.npz, and manifest.json with signals, origin and the SHA-256 of all numbers.

Slices are the paper's trajectories, on which every model is validated and tested. A model may
learn from any window of the training episodes.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from offline.data.conditions import FrictionBand
from offline.data.manifest import Imported, Manifest, Origin, Roads, read_manifest
from offline.data.recording import PATH_STATES, Anchor, Recording, Starts, cut
from offline.data.signals import Array32, Roles, Rows, Trajectories
from rt_controller.contract.car import Car
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.files import DamagedArchiveError, atomic_write, read_arrays, write_text
from rt_controller.contract.limits import SteeringGeometry
from rt_controller.contract.signals import Schema

Part = Literal["train", "validation", "test"]

RECORDING_FILE = "recording.npz"
MANIFEST_FILE = "manifest.json"
PARTS: tuple[Part, ...] = ("train", "validation", "test")
HELD_BACK = 0.1
"""share of the episodes for validation, and the same share for the test"""

_POSE_COLUMNS = ("X_m", "Y_m", "yaw_rad")
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
        return None if self.geometry is None else Car(self.geometry)

    @property
    def geometry(self) -> SteeringGeometry | None:
        """Of the car's steering; None: not known."""
        return self.manifest.geometry

    @property
    def schema(self) -> Schema:
        return self.manifest.schema

    @property
    def roles(self) -> Roles:
        return self.manifest.roles

    def conditions_at(self, rows: Rows) -> Array32:
        """True road, wind, load and tyres (..., q) at these rows of the recording.

        The columns are `manifest.conditions`; each value is held until the next row.

        Raises:
            DatasetError: the data set has no conditions.
        """
        if self.recording.conditions is None:
            raise DatasetError(
                f"expected a data set with the true conditions of every sample, found one without "
                f"({self.sha256:.16}…). Make one with offline-data --recipe varied."
            )
        return self.recording.conditions[rows]

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
    geometry: SteeringGeometry | None = None,
    conditions: tuple[str, ...] = (),
    rejected: int = 0,
    rejected_by_friction: tuple[FrictionBand, ...] = (),
) -> Dataset:
    """Write a data set; the manifest is written last and makes it valid.

    Raises:
        DatasetError: a number is not finite, or the folder has no room.
    """
    anchor = slices.anchor or Anchor(*(np.zeros(0) for _ in Anchor._fields))
    slice_arrays = (slices.row, slices.episode, *anchor)
    arrays: dict[str, NDArray[Any]] = {
        **{name: array for name, array in recording._asdict().items() if array is not None},
        "part": part,
        **dict(zip(_SLICE_ARRAYS, slice_arrays, strict=True)),
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
        geometry=geometry,
        conditions=conditions,
        rejected_by_friction=rejected_by_friction,
    )
    dataset = Dataset(recording, slices, part, manifest)
    _require_valid(folder / RECORDING_FILE, dataset)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with atomic_write(folder / RECORDING_FILE) as stream:
            np.savez(stream, **arrays)  # type: ignore[arg-type]
        write_text(folder / MANIFEST_FILE, manifest.to_json())
    except OSError as error:
        raise DatasetError(
            f"{folder}: expected a folder with room for a data set, found: {error.strerror}. "
            f"Choose another with --data."
        ) from error
    return dataset


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
    arrays = _read_arrays(path, manifest, remedy)
    found = _digest(arrays, manifest.schema, manifest.roles, manifest.roads, manifest.conditions)
    if found != manifest.sha256:
        raise DatasetError(
            f"{path}: expected numbers of SHA-256 {manifest.sha256:.16}…, found {found:.16}…: the "
            f"file or its manifest was altered, or they are not of one data set. {remedy}"
        )
    row, episode, *columns = (arrays[name] for name in _SLICE_ARRAYS)
    anchor = Anchor(*columns)
    dataset = Dataset(
        Recording(**{name: arrays[name] for name in Recording._fields if name in arrays}),
        Starts(row, episode, anchor if len(anchor.ey_m) == len(row) else None),
        arrays["part"],
        manifest,
    )
    _require_valid(path, dataset)
    return dataset


def _read_arrays(path: Path, manifest: Manifest, remedy: str) -> dict[str, NDArray[Any]]:
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
    return arrays


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


def _require_valid(path: Path, dataset: Dataset) -> None:
    """Return if the arrays hold the signals of the manifest, all finite, and poses just with roads.

    Raises:
        DatasetError: they do not.
    """
    recording, slices, schema = dataset.recording, dataset.slices, dataset.schema
    has_roads = dataset.manifest.roads is not None
    path_states = len(PATH_STATES) if recording.has_poses else 0
    samples = len(recording.x)
    conditions = np.zeros((samples, 0)) if recording.conditions is None else recording.conditions
    names_of_conditions = dataset.manifest.conditions
    expected = (
        len(schema.states) - path_states,
        len(schema.inputs),
        len(schema.exogenous),
        (samples, len(names_of_conditions)),
        has_roads,
        has_roads,
    )
    columns = tuple(array.shape[1] for array in (recording.x, recording.u, recording.w))
    found = (*columns, conditions.shape, recording.has_poses, slices.anchor is not None)
    if expected != found:
        raise DatasetError(
            f"{path}: expected {expected[0]} recorded states, {expected[1]} inputs, {expected[2]} "
            f"exogenous signals, conditions of shape {expected[3]}, poses: {expected[4]}, slices "
            f"on roads: {expected[5]}, found {', '.join(str(part) for part in found)}. Manifest "
            f"and recording are not of one data set: make it again."
        )
    for array, names in (
        (recording.x, schema.state_names),
        (recording.u, schema.input_names),
        (recording.w, schema.exogenous_names),
        (recording.pose, _POSE_COLUMNS),
        (conditions, names_of_conditions),
    ):
        if not np.all(np.isfinite(array)):
            row, column = np.argwhere(~np.isfinite(array))[0]
            episode = int(np.searchsorted(recording.first, row, side="right")) - 1
            raise DatasetError(
                f"{path}: expected finite numbers, found {array[row, column]} for "
                f"{names[column]} at sample {row - recording.first[episode]} of episode "
                f"{episode}. Leave that episode out, or make the data set again."
            )
    for name, values in slices.anchor._asdict().items() if slices.anchor else ():
        if not np.all(np.isfinite(values)):
            row = int(np.argmax(~np.isfinite(values)))
            raise DatasetError(
                f"{path}: expected finite numbers, found {values[row]} for {name} of slice {row}. "
                f"Leave that slice out, or make the data set again."
            )
