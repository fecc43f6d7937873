"""manifest.json: what a data set is, what it was made from, and the hash of its numbers."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from offline.excitation import Recipe
from offline.roles import Roles
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.schema import Schema

FORMAT_VERSION = 2


@dataclass(frozen=True, slots=True)
class Driven:
    """Everything that the numbers of a data set of the simulated car follow from."""

    recipe: Recipe
    episodes: int
    seed: int
    """of the random streams and of the split"""
    plant_fingerprint: str
    """how the car answers (`offline.generate.plant_fingerprint`)"""

    @property
    def name(self) -> str:
        """Folder name of such a data set in the cache."""
        digest = hashlib.sha256(json.dumps(asdict(self), sort_keys=True).encode()).hexdigest()
        return f"{self.episodes}-episodes-{digest[:16]}"


@dataclass(frozen=True, slots=True)
class SourceFile:
    """A log that went into a data set."""

    name: str
    sha256: str


@dataclass(frozen=True, slots=True)
class Imported:
    """Logs of a real car, or of another simulator, and how they were read."""

    files: tuple[SourceFile, ...]
    mapping: str
    """the text of the mapping file"""
    episodes: int
    """stretches without a gap"""
    seed: int
    """of the split"""


Origin = Driven | Imported


@dataclass(frozen=True, slots=True)
class Roads:
    """The roads that may be laid under a recording with poses."""

    curvatures_per_m: tuple[float, ...]
    ey_m: float
    """largest lateral error at a window's start"""
    epsi_rad: float
    """largest heading error there"""


@dataclass(frozen=True, slots=True)
class Manifest:
    """What a data set is."""

    schema: Schema
    roles: Roles
    roads: Roads | None
    """None: the recording has no poses, and is on the road it was driven on"""
    sha256: str
    """of all numbers, and of schema, roles and roads above (`offline.dataset`)"""
    trajectories: int
    """slices that the parts are judged on"""
    rejected_episodes: int
    versions: Mapping[str, str]
    """by package"""
    origin: Origin
    format_version: int = FORMAT_VERSION

    @property
    def rejected_fraction(self) -> float:
        """Share of the tries that were thrown away."""
        return self.rejected_episodes / (self.rejected_episodes + self.origin.episodes)

    def to_json(self) -> str:
        """The text of the file; `read_manifest` is the inverse."""
        return json.dumps(asdict(self), indent=2) + "\n"


_MANIFEST = TypeAdapter(Manifest)


def read_manifest(path: Path) -> Manifest:
    """The manifest of a data set.

    Raises:
        DatasetError: it is missing, damaged or of another format.
    """
    fields = _read_object(path)
    if fields.get("format_version") != FORMAT_VERSION:
        raise DatasetError(
            f"{path}: expected format_version = {FORMAT_VERSION}, found "
            f"{fields.get('format_version')}. Delete the folder and make the data set again."
        )
    try:
        return _MANIFEST.validate_python(fields)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise DatasetError(
            f"{path}: expected a complete manifest, found for {place}: {first['msg']}. Delete the "
            f"folder and run offline-data again."
        ) from error


def _read_object(path: Path) -> dict[str, Any]:
    try:
        fields = json.loads(path.read_text(encoding="utf-8"))
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
    if not isinstance(fields, dict):
        raise DatasetError(
            f"{path}: expected a JSON object, found {type(fields).__name__}. Delete the folder "
            f"and run offline-data again."
        )
    return fields
