"""The manifest of a data set: signals, parts, and where its episodes come from."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pydantic import TypeAdapter, ValidationError

from offline.data.recipe import Recipe
from offline.data.signals import Roles
from rt_controller.contract.car import car_of
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.files import read_text
from rt_controller.contract.limits import SteeringGeometry
from rt_controller.contract.signals import Schema
from rt_controller.model.bundle import Bundle
from sim_bridge.plant.shipped_cars import DEFAULT_CAR

Part = Literal["train", "validation", "test"]

FORMAT_VERSION = 2
RECORDING_FILE = "recording.npz"
MANIFEST_FILE = "manifest.json"
PARTS: tuple[Part, ...] = ("train", "validation", "test")
HELD_BACK = 0.1
"""share of the episodes for validation, and the same share for the test"""
CAR_OF_LOGS = (
    "the car of the logs, not the simulated one: rt-controller --bus virtual drives another car "
    "with it"
)


@dataclass(frozen=True, slots=True)
class Simulated:
    """What a data set of the simulated car was made from; it determines every number."""

    recipe: Recipe
    episodes: int
    seed: int
    """of the random streams and of the split into parts"""
    plant_fingerprint: str
    """as from `offline.data.generate.plant_fingerprint`"""

    @property
    def name(self) -> str:
        """Folder name of a new data set of this origin in the cache."""
        return f"{self.episodes}-episodes-{hashlib.sha256(repr(self).encode()).hexdigest():.16}"


@dataclass(frozen=True, slots=True)
class SourceFile:
    """A log that a data set was made from."""

    name: str
    sha256: str


@dataclass(frozen=True, slots=True)
class Imported:
    """Logs of a real car or another simulator, and how they were read."""

    files: tuple[SourceFile, ...]
    mapping: str
    """the text of the mapping file"""
    episodes: int
    """stretches without a gap"""
    seed: int
    """of the split into parts"""
    lateral_speed_std_mps: float | None = None
    """standard deviation of a lateral speed that was estimated; None: it was measured"""


Origin = Simulated | Imported


@dataclass(frozen=True, slots=True)
class Roads:
    """The roads on which windows of a recording with poses may be placed."""

    curvatures_per_m: tuple[float, ...]
    ey_m: float
    """largest lateral error at the start of a window"""
    epsi_rad: float
    """largest heading error there"""


@dataclass(frozen=True, slots=True)
class Manifest:
    """The contents of manifest.json."""

    schema: Schema
    roles: Roles
    roads: Roads | None
    """None: the recording has no poses and stays on the road where it was made"""
    sha256: str
    """of all numbers, and of schema, roles and roads above"""
    trajectories: int
    """number of slices"""
    rejected_episodes: int
    versions: Mapping[str, str]
    """by package"""
    origin: Origin
    geometry: SteeringGeometry | None = None
    """of the car; None: not known"""
    conditions: tuple[str, ...] = ()
    """columns of the conditions in the recording; none: it has no conditions"""
    car: Mapping[str, Any] = field(default_factory=dict)
    """further values of the car that are not the default ones, as `Car.own_values`"""
    format_version: int = FORMAT_VERSION

    @property
    def rejected_fraction(self) -> float:
        """Share of the drawn episodes that were rejected."""
        return self.rejected_episodes / (self.rejected_episodes + self.origin.episodes)

    def to_json(self) -> str:
        """The text of the file; `read_manifest` is the inverse."""
        return _MANIFEST.dump_json(self, indent=2).decode() + "\n"


_MANIFEST = TypeAdapter(Manifest)


def read_manifest(path: Path) -> Manifest:
    """The manifest of a data set.

    Raises:
        DatasetError: it is missing, damaged or of another format.
    """
    try:
        fields = json.loads(read_text(path))
        found = fields.get("format_version") if isinstance(fields, dict) else type(fields).__name__
        if found != FORMAT_VERSION:
            expected = f"a JSON object with format_version = {FORMAT_VERSION}, found {found}"
        else:
            manifest = _MANIFEST.validate_python(fields)
            if manifest.geometry is not None:
                car_of({**manifest.geometry._asdict(), **manifest.car})
            return manifest
    except FileNotFoundError as error:
        raise DatasetError(
            f"{path}: expected the manifest of a data set, found no such file. Make one with "
            f"offline-data, or point --data at its folder."
        ) from error
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        expected = f"a complete manifest, found for {place}: {first['msg']}"
    except (OSError, ValueError, RecursionError) as error:
        expected = f"a manifest in JSON, found something unreadable ({error})"
    raise DatasetError(
        f"{path}: expected {expected}. Delete the folder and make the data set again with "
        f"offline-data or offline-import."
    )


def describe_car(origin: Origin) -> str:
    """The car that a model of this data set is of, as printed on its card."""
    return f"simulated {DEFAULT_CAR}" if isinstance(origin, Simulated) else CAR_OF_LOGS


def describe_training(settings: Mapping[str, object], origin: Origin) -> str:
    """The field `training` of a bundle as JSON: the settings, and the origin of the episodes."""
    kind = {"data": "imported"}
    if isinstance(origin, Simulated):
        kind = {"data": "driven", "conditions": origin.recipe.text}
    return json.dumps({**settings, **kind, "episodes": origin.episodes, "data_seed": origin.seed})


def is_held_out(bundle: Bundle, manifest: Manifest) -> bool:
    """True if no test episode of that data set was used to train the model.

    Two imports may share a log, so a model trained on one import is not held out from another.
    """
    if bundle.data_sha256 == manifest.sha256:
        return True
    try:
        training = json.loads(bundle.training)
        is_of_drives = bool(training["data"] == "driven")
        seed, episodes = int(training["data_seed"]), int(training["episodes"])
    except (ValueError, KeyError, TypeError):
        return False
    origin = manifest.origin
    if not (is_of_drives and isinstance(origin, Simulated)):
        return is_of_drives != isinstance(origin, Simulated)
    return seed != origin.seed or episodes == origin.episodes
