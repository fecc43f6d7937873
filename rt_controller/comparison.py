"""Controllers compared: the same scenarios with each, in simulated time, on all cores."""

import base64
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rt_controller.config import ControllerConfig, require_config
from rt_controller.contract.errors import (
    ConfigError,
    ControlLawError,
    PlantError,
    needs_extra,
    require_packages,
)
from rt_controller.contract.faults import StopCause
from rt_controller.control.law import ControlLaw
from rt_controller.controllers import BASELINES, law_file, open_law, require_law
from rt_controller.drive.archive import pack_drive, unpack_drive
from rt_controller.drive.comfort import jerk_of, wheel_rate_rms_degps
from rt_controller.drive.table import Drive
from rt_controller.model.bundle import Bundle
from rt_controller.node import build_planner
from rt_controller.realtime.timing import DeadlineAccount
from rt_controller.report.comparison_page import ComparedFigures
from rt_controller.settings import CarSettings
from rt_controller.simulation import drive_in_lockstep

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sim_bridge.campaign import Backend
    from sim_bridge.scenario import Scenario

FIGURES = (
    *("ey_rms_m", "ey_peak_m", "speed_rms_mps", "speed_peak_mps", "wheel_rate_rms_degps"),
    *("lateral_jerk_rms_mps3", "jerk_rms_mps3", "step_p50_us", "step_p99_us"),
)
"""fields of `ComparedDrive` that are compared; smaller is better"""
TRUE_FIGURES = ("ey_rms_m", "ey_peak_m", "speed_rms_mps", "speed_peak_mps")
"""measured at the car, not on the bus"""


class ComparedDrive(NamedTuple):
    """Figures of one drive; NaN where it failed."""

    controller: str
    scenario: str
    seed: int
    """of the noise of the sensors; 0: no noise"""
    ey_rms_m: float = nan
    """lateral error of the car itself"""
    ey_peak_m: float = nan
    speed_rms_mps: float = nan
    speed_peak_mps: float = nan
    wheel_rate_rms_degps: float = nan
    """of the steering wheel, as commanded"""
    lateral_jerk_rms_mps3: float = nan
    """comfort: rate of change of speed times yaw rate"""
    jerk_rms_mps3: float = nan
    """comfort: rate of change of the acceleration along the road"""
    step_p50_us: float = nan
    """time of the processor from frames in to frames out"""
    step_p99_us: float = nan
    preparation_p50_us: float = nan
    """work in the period before the step"""
    stop_s: float | None = None
    """time at which a safe stop began"""
    failure: str = ""
    """why there is no drive, or why it ended early"""


@dataclass(frozen=True, slots=True)
class Comparison:
    """All drives of a comparison."""

    rows: tuple[ComparedDrive, ...]
    """by scenario, controller and seed, in the order that was asked for"""
    drives: Mapping[tuple[str, str, int], Drive]
    """by controller, scenario and seed; without those that failed"""

    @property
    def controllers(self) -> tuple[str, ...]:
        """Names in the order that was asked for."""
        return tuple(dict.fromkeys(row.controller for row in self.rows))

    @property
    def scenarios(self) -> tuple[str, ...]:
        """Names in the order that was asked for."""
        return tuple(dict.fromkeys(row.scenario for row in self.rows))

    def of(self, controller: str, scenario: str) -> list[ComparedDrive]:
        """The drives of a controller in a scenario, one for each seed."""
        return [
            row for row in self.rows if (row.controller, row.scenario) == (controller, scenario)
        ]

    def by_scenario(self) -> dict[tuple[str, str], ComparedFigures]:
        """Mean and worst figures over the seeds, by scenario and controller."""
        found = {}
        for scenario in self.scenarios:
            for controller in self.controllers:
                rows = self.of(controller, scenario)
                values = {name: [getattr(row, name) for row in rows] for name in FIGURES}
                found[scenario, controller] = ComparedFigures(
                    {name: float(np.mean(each)) for name, each in values.items()},
                    {name: float(np.max(each)) for name, each in values.items()},
                    next((row.failure for row in rows if row.failure), ""),
                )
        return found

    def first_drives(self, scenario: str) -> dict[str, Drive]:
        """Drive of each controller in a scenario with the first seed, for a picture."""
        found: dict[str, Drive] = {}
        for (controller, driven, _), drive in self.drives.items():
            if driven == scenario:
                found.setdefault(controller, drive)
        return found

    def figures(self) -> list[dict[str, Any]]:
        """The rows for JSON."""
        return [row._asdict() for row in self.rows]

    def to_pandas(self) -> Any:
        """The rows as a `pandas.DataFrame`."""
        with needs_extra("logs", "A data frame"):
            import pandas as pd

        return pd.DataFrame(self.figures())

    def plot(self) -> "Figure":
        """Overlay of the first scenario's drives: from above, errors and steering over time."""
        from rt_controller.report.overlay import overlay

        return overlay(self.first_drives(self.scenarios[0]))

    def __repr__(self) -> str:
        return (
            f"<Comparison of {', '.join(self.controllers)} in {len(self.scenarios)} scenarios, "
            f"{len(self.rows)} drives>"
        )


def compare(
    controllers: "Sequence[str | ControlLaw]",
    scenarios: "Sequence[str | Path | Scenario] | str | Path" = ("double_lane_change",),
    *,
    seeds: int = 0,
    car: CarSettings | None = None,
    config: ControllerConfig | None = None,
    backend: "Backend | None" = None,
    results: Path | str | None = None,
    on_progress: Callable[[ComparedDrive], None] = lambda row: None,
) -> Comparison:
    """Drive every scenario with every controller, in simulated time, in processes.

        comparison = compare(["mdk-net", "stanley", PurePursuit()], ["slalom", "corner"])
        comparison.plot().savefig("overlay.svg")

    Args:
        controllers: at least one, each as `controller` of `simulate`.
        scenarios: each as of `simulate`.
        seeds: drives of each scenario with noise of the sensors, each with another seed; 0: one
            drive without noise.
        car: plant, parameters, friction, delays and faults of all drives.
        config: settings of the controllers.
        backend: where the drives run; default: one process per core.
        results: file that keeps every finished drive. The same call goes on after an interruption,
            and drives again only with a controller or scenario that has changed. For controllers
            that have a name.
        on_progress: is called after each drive, in any order.

    Raises:
        ConfigError: an argument is refused; all are checked before the first drive.
        MissingExtraError: joblib is not installed.
    """
    require_packages("compare", ("joblib",), "compare")
    from sim_bridge.campaign import THIS_MACHINE, run_campaign

    settings, conditions = require_config(config), car or CarSettings()
    entrants = _open_all(controllers, results is not None)
    courses = _load_all(scenarios)
    tasks = {
        (name, course, seed): (entrant, scenario, seed, conditions, settings)
        for course, scenario in courses.items()
        for name, entrant in entrants.items()
        for seed in (range(1, seeds + 1) if seeds else (0,))
    }
    keys = {f"{names}: {_digest(*task)}": names for names, task in tasks.items()}
    found: dict[tuple[str, str, int], tuple[ComparedDrive, Drive | None]] = {}
    campaign = run_campaign(
        _drive,
        [(key, (names, *tasks[names])) for key, names in keys.items()],
        backend or THIS_MACHINE,
        None if results is None else Path(results),
    )
    for key, (figures, packed) in campaign:
        if key not in keys:  # of an earlier version of a controller
            continue
        row = ComparedDrive(**figures)
        drive = packed and unpack_drive(base64.b64decode(packed), str(results))
        found[keys[key]] = row, drive
        on_progress(row)
    return Comparison(
        tuple(found[names][0] for names in tasks),
        {names: drive for names in tasks if (drive := found[names][1]) is not None},
    )


def _open_all(
    controllers: "Sequence[str | ControlLaw]", needs_names: bool
) -> dict[str, str | ControlLaw]:
    """The controllers by a short name, each opened once, so that a wrong one is refused at once."""
    found: dict[str, str | ControlLaw] = {}
    for each in controllers:
        if isinstance(each, str):
            config = ControllerConfig(controller=each)
            if config.controller is None:
                Bundle.load(config.model)
            else:
                open_law(each)
            name = each.rpartition(":")[2]
            name = each if name in found else name
        else:
            require_law(each)
            name = type(each).__name__
            if needs_names:
                raise ConfigError(
                    f"results: expected controllers by name, found the object {name}. Name it as "
                    f"FILE.py:CLASS, or leave the file of results out."
                )
        if name in found:
            raise ConfigError(f"controllers: expected different ones, found {name} twice.")
        found[name] = each
    if not found:
        raise ConfigError(
            f"controllers: expected at least one, such as mdk-net, {', '.join(BASELINES)}."
        )
    return found


def _load_all(scenarios: "Sequence[str | Path | Scenario] | str | Path") -> "dict[str, Scenario]":
    """The scenarios by name: that of the file, of an object its own."""
    from sim_bridge.scenario import Scenario, load_scenario

    found: dict[str, Scenario] = {}
    for each in [scenarios] if isinstance(scenarios, str | Path) else scenarios:
        if isinstance(each, Scenario):
            name, scenario = each.name, each
        else:
            name, scenario = Path(each).stem, load_scenario(str(each))
        if name in found:
            raise ConfigError(f"scenarios: expected different ones, found {name} twice.")
        found[name] = scenario
    if not found:
        raise ConfigError("scenarios: expected at least one, such as double_lane_change.")
    return found


def _digest(
    entrant: str | ControlLaw,
    scenario: "Scenario",
    seed: int,
    conditions: CarSettings,
    settings: ControllerConfig,
) -> str:
    """Digest of all that a drive depends on, but for the object of a law."""
    from sim_bridge.campaign import object_digest

    config = _config(settings, entrant)
    file = None if config.controller is None else law_file(config.controller)
    text = None if file is None else file.read_text(encoding="utf-8")
    parts = (conditions.model_dump_json(), config.model_dump_json(), text)
    return object_digest((scenario, *parts, Bundle.load(config.model).sha256))


def _config(settings: ControllerConfig, entrant: str | ControlLaw) -> ControllerConfig:
    """The settings with the controller, if that has a name."""
    if not isinstance(entrant, str):
        return settings
    return ControllerConfig(**{**dict(settings), "controller": entrant})


def _drive(
    names: tuple[str, str, int],
    entrant: str | ControlLaw,
    scenario: "Scenario",
    seed: int,
    conditions: CarSettings,
    settings: ControllerConfig,
) -> tuple[dict[str, Any], str | None]:
    """Figures of one drive, and the drive itself, packed, as text."""
    from sim_bridge.faults.sensors import sensor_noise

    config = _config(settings, entrant)
    # A law begins every drive as it was given, as it does in another process.
    law = None if isinstance(entrant, str) else deepcopy(entrant)
    bundle = Bundle.load(config.model)
    accounts: list[DeadlineAccount] = []
    faults = sensor_noise(np.random.default_rng(seed)) if seed else []
    driven = replace(
        scenario,
        faults=(*scenario.faults, *faults),
        metrics=tuple(dict.fromkeys((*scenario.metrics, *TRUE_FIGURES))),
    )
    try:
        drive = drive_in_lockstep(
            config,
            bundle,
            build_planner(bundle, config, law),
            conditions,
            scenario=driven,
            after_tick=lambda session: accounts.append(session.record.deadlines),
        )
    except (ControlLawError, PlantError) as error:
        return ComparedDrive(*names, failure=str(error))._asdict(), None
    true = {figure.name: figure.value for figure in drive.car_figures}
    jerk, step = jerk_of(drive), accounts[-1].percentiles("cpu_us")
    controller, course, seed = names
    row = ComparedDrive(
        controller,
        course,
        seed,
        **{figure: float(true[figure]) for figure in TRUE_FIGURES},
        wheel_rate_rms_degps=wheel_rate_rms_degps(drive),
        lateral_jerk_rms_mps3=jerk.lateral_mps3,
        jerk_rms_mps3=jerk.along_mps3,
        step_p50_us=step.p50,
        step_p99_us=step.p99,
        preparation_p50_us=accounts[-1].percentiles("preparation_us").p50,
        stop_s=drive.stop_s,
        failure="" if drive.stop_s is None else f"safe stop: {StopCause[drive.stop_cause].value}",
    )
    return row._asdict(), base64.b64encode(pack_drive(drive)).decode()
