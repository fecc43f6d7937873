"""The results file: parts of measurements, and what is kept of the files of other commands."""

import json
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.fault_matrix.summary import MatrixSummary, lines_of
from offline.evaluation.comparison import FAIR_LTI
from offline.evaluation.test_sets import LIBRARY
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.figures import write_figures
from rt_controller.model.artifact import SHIPPED_MODEL, shipped_model
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


Found = Mapping[str, Any]


def _evaluation(found: Found) -> Figures:
    """What the documents print of the table of an evaluation."""
    rows: dict[tuple[str, str], list[Found]] = {}
    for row in found["rows"]:
        rows.setdefault((row["part"], row["model"]), []).append(row)
    library = {model: of_model for (part, model), of_model in rows.items() if part == LIBRARY}
    sets = [part for part in found["parts"] if part["is_whole_set"] and part["best_linear"]]
    return {
        "mse": {
            model: {
                f"{row['state']} ({row['unit']})²": row["mse"] for row in of_model if row["unit"]
            }
            for model, of_model in library.items()
            if model != FAIR_LTI
        },
        "mse_ratios": {
            model: _ratios(of_model)
            for model, of_model in library.items()
            if model != found["reference"]
        },
        "mse_sets": {
            part["part"]: {
                "number": part["trajectories"],
                "best linear": part["best_linear"],
                **_ratios(rows[part["part"], part["best_linear"]]),
            }
            for part in sets
        },
    }


def _ratios(rows: Iterable[Found]) -> Figures:
    """MSE over that of the reference: values of the states; the means with their intervals."""
    return {
        row["state"]: row["over_reference"]
        if row["unit"]
        else {
            "value": row["over_reference"],
            "low": row["over_reference_low"],
            "high": row["over_reference_high"],
        }
        for row in rows
    }


def _fault_matrix(found: Found) -> Figures:
    return {"fault_matrix": "; ".join(lines_of(MatrixSummary(**found["summary"])))}


def _false_alarms(found: Found) -> Figures:
    sentence = (
        f"{found['drives_with_false_alarm']} of {found['drives']:,} drives had a false alarm, "
        f"in {found['driven_h']:.2f} hours of simulated driving; "
        f"{found['drives_that_lose_the_path_without_checks_too']} left their path, with checks and "
        f"without, {found['drives_that_lose_the_path_where_stanley_keeps_it']} of them where "
        "stanley keeps it"
    )
    shares = {
        each["check"]: {
            "largest value / threshold": each["largest_share_of_threshold"],
            "drives with a false alarm": each["drives_with_false_alarm"],
        }
        for each in found["checks"]
    }
    return {"false_alarms": sentence, "alarm_margins": shares}


def _paper(found: Found) -> Figures:
    tables: Figures = {"paper_overview": found["overview"]}
    for element in PAPER_ELEMENTS:
        tables |= found[element]["tables"]
    return tables


PAPER_ELEMENTS = {
    *("table-1", "algorithm-1", "table-2"),
    *("figure-3", "figure-4", "computation-time"),
}
"""all names of `benchmarks.paper`: the result of one with --only is refused"""
SOURCES: dict[str, tuple[set[str], Callable[[Found], Figures]]] = {
    "evaluation": ({"parts", "rows", "model_sha256"}, _evaluation),
    "fault_matrix": ({"rows", "summary"}, _fault_matrix),
    "false_alarms": ({"driven_h", "checks"}, _false_alarms),
    "paper": ({"overview", *PAPER_ELEMENTS}, _paper),
}
"""by piece: the keys that only its files have together, and what is kept of them"""


def read_import(file: Path) -> tuple[str, Part]:
    """The piece that the file belongs to, and its only part.

    Raises:
        ConfigError: the file is of no such command, or of another model than the shipped one.
    """
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigError(f"--import {file}: expected a JSON file, found {error}.") from error
    keys = set(found) if isinstance(found, dict) else set()
    piece = next((name for name, (own, _) in SOURCES.items() if own <= keys), None)
    if piece is None:
        raise ConfigError(f"--import {file}: expected results of {', '.join(SOURCES)}.")
    shipped = hashes_of((SHIPPED_MODEL,))
    if not shipped.items() <= found.get("model_sha256", shipped).items():
        raise ConfigError(
            f"--import {file}: expected results of the shipped {SHIPPED_MODEL}, found those of "
            f"another model. Run the command again."
        )
    return piece, Part("all", (SHIPPED_MODEL,), lambda: SOURCES[piece][1](found))
