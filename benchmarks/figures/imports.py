"""Results of commands that take longer, from the JSON files that these wrote.

Each is reduced to tables: figures by the names of a row and a column.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from benchmarks.figures.results import Figures, Part, hashes_of
from rt_controller.contract.errors import ConfigError
from rt_controller.model.artifact import SHIPPED_MODEL
from sim_bridge.faults.matrix.summary import MatrixSummary, lines_of

Found = Mapping[str, Any]


def _evaluation(found: Found) -> Figures:
    library = found["sets"]["library"]
    slices = [part for series in found["series"].values() for part in series["slices"]]
    return {
        "mse": {
            name: {state: x["value"] for state, x in model["mse"].items()}
            for name, model in library["models"].items()
        },
        "mse_ratios": {
            name: _ratios(ratios)
            for name, ratios in library["baseline_mse_over_model_mse"][SHIPPED_MODEL].items()
        },
        "mse_slices": {
            f"{part['set']}, {part['label']}": {
                "number": part["n_trajectories"],
                "best linear": best,
                **_ratios(part["baseline_mse_over_model_mse"][SHIPPED_MODEL][best]),
            }
            for part in slices
            if (best := part["best_baseline"].get("linear"))
        },
    }


def _ratios(by_state: Found) -> Figures:
    """Values of the states; the means with their intervals."""
    return {name: x if "mean" in name else x["value"] for name, x in by_state.items()}


def _fault_matrix(found: Found) -> Figures:
    return {"fault_matrix": "; ".join(lines_of(MatrixSummary(**found["summary"])))}


def _false_alarms(found: Found) -> Figures:
    sentence = (
        f"{found['drives_with_false_alarm']} of {found['drives']:,} drives had a false alarm, "
        f"in {found['driven_h']:.2f} hours of simulated driving; "
        f"{found['drives_that_lose_the_path_without_checks_too']} cars had too little grip "
        "and left their path, with checks and without"
    )
    shares = {
        each["check"]: {
            "largest value / threshold": each["largest_share_of_threshold"],
            "drives with a false alarm": each["drives_with_false_alarm"],
        }
        for each in found["checks"]
    }
    return {"false_alarms": sentence, "alarm_margins": shares}


def _solvers(found: Found) -> Figures:
    """Of the QP of the shipped controller: slew rates, vectors known at the tick."""
    qps = {"model": SHIPPED_MODEL, "tier": "slew", "mode": "prepared"}
    times = ("p50_us", "p99_us", "p50_us_over_default", "p99_us_over_default")
    recordings = [one for one in found["recordings"] if qps.items() <= one.items()]
    return {"solvers": _side_by_side(recordings, times)}


def _side_by_side(scenarios: list[Found], columns: tuple[str, ...]) -> Figures:
    table: Figures = {}
    for one in scenarios:
        for name, figures in one["solvers"].items():
            named = {f"{one['scenario']}: {column}": figures[column] for column in columns}
            table[name] = table.get(name, {}) | named
    return table


def _cadence(found: Found) -> Figures:
    stages = ("step", "receive", "plan", "send", "qp", "read_ahead", "total", "preparation")
    quantiles = ("p50", "p99", "p999", "max")
    return {
        "cadence": {
            f"{one['variant']}: {stage}": {f"{q}_us": one[f"{stage}_us"][q] for q in quantiles}
            for one in found["variants"]
            for stage in stages
        }
    }


SOURCES: dict[str, tuple[set[str], Callable[[Found], Figures]]] = {
    "evaluation": ({"sets", "series", "model_sha256"}, _evaluation),
    "fault_matrix": ({"rows", "summary"}, _fault_matrix),
    "false_alarms": ({"driven_h", "checks"}, _false_alarms),
    "solvers": ({"recordings", "not_installed"}, _solvers),
    "cadence": ({"variants", "transport"}, _cadence),
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
