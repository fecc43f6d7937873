"""The results file of the command: parts of measurements, each stored as soon as it is finished."""

import json
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from rt_controller.contract.figures import write_figures
from rt_controller.model.artifact import shipped_model
from rt_controller.model.bundle import Bundle

Figures = dict[str, Any]
"""numbers by name; each name ends in its unit"""
Pieces = dict[str, dict[str, Figures]]
"""figures by piece and part, in the order of measurement"""


class Part(NamedTuple):
    """A measurement of some seconds that is stored by itself."""

    name: str
    models: tuple[str, ...]
    """shipped models that it measures: the part is measured again if one has changed"""
    measure: Callable[[], Figures]


class Results:
    """Figures of all parts in one JSON file, with the SHA-256 of the models they were made with."""

    def __init__(self, path: Path) -> None:
        self._path = path
        text = path.read_text(encoding="utf-8") if path.exists() else "{}"
        self.found: dict[str, dict[str, Figures]] = json.loads(text)

    @property
    def pieces(self) -> Pieces:
        """The figures of all parts that have been measured."""
        return {
            piece: {name: part["figures"] for name, part in parts.items()}
            for piece, parts in self.found.items()
        }

    def missing(self, piece: str, parts: Iterable[Part]) -> list[Part]:
        """The parts that are not in the file, or were measured with another model."""
        stored = self.found.get(piece, {})
        return [
            part
            for part in parts
            if part.name not in stored
            or stored[part.name]["models_sha256"] != hashes_of(part.models)
        ]

    def put(self, piece: str, part: Part, figures: Figures) -> None:
        """Store the figures of a part, and write the file."""
        stored = {"models_sha256": hashes_of(part.models), "figures": figures}
        self.found.setdefault(piece, {})[part.name] = stored
        write_figures(self._path, self.found)

    def keep(self, piece: str, names: Iterable[str]) -> None:
        """Drop the parts that no longer exist, and put the others into this order."""
        stored = self.found.get(piece, {})
        self.found[piece] = {name: stored[name] for name in names if name in stored}
        write_figures(self._path, self.found)


def hashes_of(models: Iterable[str]) -> dict[str, str]:
    """SHA-256 of shipped models by their names."""
    return {model: _hash_of(model) for model in models}


@cache
def _hash_of(model: str) -> str:
    return Bundle.load(shipped_model(model)).sha256
