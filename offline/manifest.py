"""manifest.json: what a data set is, what it was made from, and the hash of its numbers."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

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

FORMAT_VERSION = 1

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


@dataclass(frozen=True, slots=True)
class Origin:
    """Everything that the numbers of a data set follow from."""

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
class Manifest:
    """What a data set is."""

    sha256: str
    """of all numbers (`offline.dataset`)"""
    trajectories: int
    rejected_episodes: int
    versions: Mapping[str, str]
    """by package"""
    origin: Origin

    @property
    def rejected_fraction(self) -> float:
        """Share of the tries that were thrown away."""
        return self.rejected_episodes / (self.rejected_episodes + self.origin.episodes)

    def to_json(self) -> str:
        """The text of the file; `read_manifest` is the inverse."""
        fields = {
            **_EXPECTED,
            "sha256": self.sha256,
            "trajectories": self.trajectories,
            "rejected_episodes": self.rejected_episodes,
            "rejected_fraction": self.rejected_fraction,
            "versions": dict(self.versions),
            **asdict(self.origin),
        }
        return json.dumps(fields, indent=2) + "\n"


_MANIFEST = TypeAdapter(Manifest)


def read_manifest(path: Path) -> Manifest:
    """The manifest of a data set of this version's signals and period.

    Raises:
        DatasetError: it is missing or damaged, or of other signals, period or format.
    """
    fields = _read_object(path)
    for key, expected in _EXPECTED.items():
        if fields.get(key) != expected:
            raise DatasetError(
                f"{path}: expected {key} = {expected}, found {fields.get(key)}. Make the data set "
                f"again with offline-data."
            )
    origin = {name: fields.get(name) for name in Origin.__dataclass_fields__}
    try:
        return _MANIFEST.validate_python({**fields, "origin": origin})
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
