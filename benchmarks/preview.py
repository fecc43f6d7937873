"""`python -m benchmarks.preview`: drives with and without the curvature of the road ahead."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, NamedTuple

import cyclopts
import numpy as np
from rich.console import Console

from rt_controller import simulate
from rt_controller.contract.figures import write_figures
from rt_controller.report.table import Column, Table, to_markdown
from sim_bridge.scenario import load_scenario
from sim_bridge.scenario.files.fault_fields import FaultFields

MODELS = ("mdk-net", "mdk-net-paper", "lti")
SCENARIOS = ("curvature_step", "road_course")
_NEVER_SENT = (FaultFields(kind="preview_lost").fault,)


class Tracking(NamedTuple):
    """Figures of one drive."""

    scenario: str
    model: str
    has_preview: bool
    ey_rms_m: float
    ey_peak_m: float
    epsi_peak_rad: float
    wheel_rate_rms_degps: float
    """of the steering wheel"""


def measure(scenario: str, model: str, has_preview: bool) -> Tracking:
    """One drive in simulated time."""
    driven = load_scenario(scenario)
    drive = simulate(driven if has_preview else replace(driven, faults=_NEVER_SENT), model=model)
    rate_radps = np.diff(drive["steer_rad"]) / np.diff(drive["time_s"])
    errors = drive.errors
    return Tracking(
        scenario,
        model,
        has_preview,
        errors.ey_rms_m,
        errors.ey_peak_m,
        errors.epsi_peak_rad,
        float(np.degrees(np.sqrt(np.mean(np.square(rate_radps))))),
    )


app = cyclopts.App(name="python -m benchmarks.preview", version_flags=[])


@app.default
def main(
    *,
    scenarios: tuple[str, ...] = SCENARIOS,
    models: tuple[str, ...] = MODELS,
    json: Annotated[Path | None, cyclopts.Parameter(name="--json")] = None,
) -> int:
    """Errors of drives in simulated time, with and without the curvature ahead on the bus.

    The table is in Markdown, as in docs/drive.md.

    Parameters
    ----------
    scenarios
        Names of shipped scenarios, or files.
    models
        Names of shipped models, or folders of bundles.
    json
        File for all figures.
    """
    console = Console(stderr=True)
    drives = []
    for scenario in scenarios:
        for model in models:
            for has_preview in (False, True):
                with console.status(f"{scenario}, {model}"):
                    drives.append(measure(scenario, model, has_preview))
    print(to_markdown(_table(drives)))
    write_figures(json, {"drives": [drive._asdict() for drive in drives]})
    return 0


def _table(drives: Sequence[Tracking]) -> Table:
    """One row for a scenario and a model; each cell: without preview → with it."""
    columns = (
        Column("scenario", is_text=True),
        Column("model", is_text=True),
        Column("e_y RMS", "m"),
        Column("e_y peak", "m"),
        Column("e_psi peak", "mrad"),
        Column("wheel rate RMS", "deg/s"),
    )
    rows = []
    scenario = ""
    for without, with_preview in zip(drives[::2], drives[1::2], strict=True):
        cells = map(" → ".join, zip(_texts(without), _texts(with_preview), strict=True))
        is_next = without.scenario != scenario
        scenario = without.scenario
        name = f"`{Path(scenario).stem}`" if is_next else ""
        rows.append((name, f"`{Path(without.model).name}`", *cells))
    return Table("", columns, tuple(rows))


def _texts(drive: Tracking) -> tuple[str, ...]:
    return (
        f"{drive.ey_rms_m:.3f}",
        f"{drive.ey_peak_m:.3f}",
        f"{1e3 * drive.epsi_peak_rad:.1f}",
        f"{drive.wheel_rate_rms_degps:.1f}",
    )


if __name__ == "__main__":
    sys.exit(app())
