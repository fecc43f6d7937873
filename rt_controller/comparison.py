"""Controllers compared: the same scenarios with each, in simulated time, on all cores."""

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
    RtControllerError,
    needs_extra,
    require_packages,
)
from rt_controller.contract.faults import StopCause
from rt_controller.contract.figures import require_writable
from rt_controller.contract.revision import source_revision
from rt_controller.control.law import ControlLaw
from rt_controller.controllers import BASELINES, law_digest, require_law
from rt_controller.drive.archive import pack_drive, unpack_drive
from rt_controller.drive.comfort import jerk_of, wheel_rate_rms_degps
from rt_controller.drive.table import Drive
from rt_controller.loop import Ending
from rt_controller.model.bundle import Bundle
from rt_controller.node import build_planner
from rt_controller.realtime.timing import DeadlineAccount
from rt_controller.report.comparison_page import ComparedFigures, comparison_table
from rt_controller.report.table import to_html
from rt_controller.settings import CarSettings
from rt_controller.simulation import drive_in_lockstep

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sim_bridge.campaign import Backend
    from sim_bridge.scenario import Scenario

FIGURES = (
    *("ey_rms_m", "ey_peak_m", "speed_rms_mps", "speed_peak_mps", "wheel_rate_rms_degps"),
    *("lateral_jerk_rms_mps3", "jerk_rms_mps3", "step_p50_us", "work_p50_us"),
)
"""fields of `ComparedDrive` that are compared; smaller is better"""
FORMAT = 1
"""of the file of results"""
REGULAR = (Ending.MISSION_OVER.value, Ending.STOPPED.value)
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
    work_p50_us: float = nan
    """the step, and the preparation before it"""
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

        drives = self.first_drives(self.scenarios[0])
        if not drives:
            raise ConfigError(
                f"{self.scenarios[0]}: expected a drive to draw, found that each one failed. Its "
                f"rows say why."
            )
        return overlay(drives)

    def _repr_html_(self) -> str:
        """The comparison in a notebook: its table, and the overlay, if matplotlib is installed."""
        seeds = max(row.seed for row in self.rows)
        table = to_html(comparison_table(self.by_scenario(), seeds))
        try:
            from rt_controller.report.canvas import to_svg

            return table + to_svg(self.plot())
        except (ModuleNotFoundError, ConfigError):
            return table

    def __repr__(self) -> str:
        return (
            f"<Comparison of {', '.join(self.controllers)} in {len(self.scenarios)} scenarios, "
            f"{len(self.rows)} drives>"
        )


def compare(
    controllers: "str | ControlLaw | Sequence[str | ControlLaw]",
    scenarios: "str | Path | Scenario | Sequence[str | Path | Scenario]" = "double_lane_change",
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

    A drive that fails is a row with its `failure`.

    Args:
        controllers: one or several, each as `controller` of `simulate`.
        scenarios: one or several, each as of `simulate`.
        seeds: drives of each scenario with noise of the sensors, each with another seed; 0: one
            drive without noise.
        car: plant, parameters, friction, delays and faults of all drives.
        config: settings of the controllers.
        backend: where the drives run; default: one process per core.
        results: file that keeps every finished drive. The same call goes on after an interruption,
            and drives again only where the program, or anything that the drive depends on, has
            changed. For controllers that have a name.
        on_progress: is called after each drive, in any order.

    Raises:
        ConfigError: controllers, scenarios or results are refused, before the first drive.
        MissingExtraError: joblib is not installed.
    """
    require_packages("compare", ("joblib",), "compare")
    from sim_bridge.campaign import THIS_MACHINE, object_digest, run_campaign

    if seeds < 0:
        raise ConfigError(f"seeds: expected 0 or more, found {seeds}.")
    file = None if results is None else Path(results)
    require_writable(file, "results")
    settings, conditions = require_config(config), car or CarSettings()
    compared = _open_controllers(controllers, settings, results is not None)
    named = _load_scenarios(scenarios)
    tasks = {
        (name, course, seed): (compared[name], scenario, seed, conditions, settings)
        for course, scenario in named.items()
        for name in compared
        for seed in (range(1, seeds + 1) if seeds else (0,))
    }
    digests = {name: _digest(each, conditions, settings) for name, each in compared.items()}
    keys = {
        f"{names}: {object_digest((digests[names[0]], named[names[1]]))}": names for names in tasks
    }
    found: dict[tuple[str, str, int], tuple[ComparedDrive, Drive | None]] = {}
    campaign = run_campaign(
        _drive,
        [(key, (names, *tasks[names])) for key, names in keys.items()],
        backend or THIS_MACHINE,
        file,
        {"format": FORMAT},
    )
    for key, (figures, packed) in campaign:
        if key not in keys:  # of an earlier version of a controller
            continue
        row = ComparedDrive(**figures)
        found[keys[key]] = row, packed and unpack_drive(packed, str(results))
        on_progress(row)
    return Comparison(
        tuple(found[names][0] for names in tasks),
        {names: drive for names in tasks if (drive := found[names][1]) is not None},
    )


def _open_controllers(
    controllers: "str | ControlLaw | Sequence[str | ControlLaw]",
    settings: ControllerConfig,
    needs_names: bool,
) -> dict[str, str | ControlLaw]:
    """The controllers by name, each built once, so that a wrong one is refused at once."""
    is_one = isinstance(controllers, str | type) or hasattr(controllers, "control")
    listed: Any = [controllers] if is_one else controllers
    if not listed:
        raise ConfigError(
            f"controllers: expected at least one, such as mdk-net, {', '.join(BASELINES)}."
        )
    short = [_short_name(each) for each in listed]
    found: dict[str, str | ControlLaw] = {}
    for each, shortened in zip(listed, short, strict=True):
        name = shortened
        if isinstance(each, str):
            chosen = _config(settings, each)
            build_planner(Bundle.load(chosen.model), chosen)
            name = shortened if short.count(shortened) == 1 else each
        else:
            require_law(each)
            if needs_names:
                raise ConfigError(
                    f"results: expected controllers by name, found the object {name}. Name it as "
                    f"FILE.py:CLASS, or leave the file of results out."
                )
        if name in found:
            raise ConfigError(f"controllers: expected different ones, found {name} twice.")
        found[name] = each
    return found


def _short_name(controller: str | ControlLaw) -> str:
    """The class of a law; of a model its folder, or that of the run whose bundle it is."""
    if not isinstance(controller, str):
        return type(controller).__name__
    folder = Path(controller)
    if folder.is_dir():
        folder = folder.resolve()
        return folder.parent.name if folder.name == "bundle" else folder.name
    return controller.rpartition(":")[2]


def _load_scenarios(
    scenarios: "str | Path | Scenario | Sequence[str | Path | Scenario]",
) -> "dict[str, Scenario]":
    """The scenarios by the name of their file, an object by its own."""
    from sim_bridge.scenario import Scenario, load_scenario

    listed: Any = [scenarios] if isinstance(scenarios, str | Path | Scenario) else scenarios
    if not listed:
        raise ConfigError("scenarios: expected at least one, such as double_lane_change.")
    short = [each.name if isinstance(each, Scenario) else Path(each).stem for each in listed]
    found: dict[str, Scenario] = {}
    for each, name in zip(listed, short, strict=True):
        is_loaded = isinstance(each, Scenario)
        unique = name if is_loaded or short.count(name) == 1 else str(each)
        if unique in found:
            raise ConfigError(f"scenarios: expected different ones, found {unique} twice.")
        found[unique] = each if is_loaded else load_scenario(str(each))
    return found


def _digest(
    controller: str | ControlLaw, conditions: CarSettings, settings: ControllerConfig
) -> str:
    """Digest of all that the drives of a controller depend on, but for the object of a law."""
    from sim_bridge.campaign import object_digest

    config = _config(settings, controller)
    files, law = list[Path](), law_digest(config.controller)
    plant = conditions.plant.partition(":")[2]
    for named in (conditions.car, conditions.faults, conditions.plant_mapping, plant):
        place = Path(named or "")
        files += sorted(place.iterdir()) if named and place.is_dir() else [place]
    contents = [file.read_bytes() for file in files if file.is_file()]
    model = Bundle.load(config.model).sha256
    texts = conditions.model_dump_json(), config.model_dump_json(), source_revision(), model
    return object_digest((texts, contents, law))


def _config(settings: ControllerConfig, controller: str | ControlLaw) -> ControllerConfig:
    """The settings with the controller, if that has a name."""
    if not isinstance(controller, str):
        return settings
    return ControllerConfig(**{**dict(settings), "controller": controller})


def _drive(
    names: tuple[str, str, int],
    controller: str | ControlLaw,
    scenario: "Scenario",
    seed: int,
    conditions: CarSettings,
    settings: ControllerConfig,
) -> tuple[dict[str, Any], str | None]:
    """Figures of one drive, and the drive itself, packed."""
    from sim_bridge.faults.sensors import sensor_noise

    config = _config(settings, controller)
    # A law begins every drive as it was given, as it does in another process.
    law = None if isinstance(controller, str) else deepcopy(controller)
    bundle = Bundle.load(config.model)
    faults = sensor_noise(np.random.default_rng(seed)) if seed else []
    driven = replace(
        scenario,
        faults=(*scenario.faults, *faults),
        metrics=tuple(dict.fromkeys((*scenario.metrics, *TRUE_FIGURES))),
    )
    accounts = dict[str, DeadlineAccount]()
    try:
        drive = drive_in_lockstep(
            config,
            bundle,
            build_planner(bundle, config, law),
            conditions,
            scenario=driven,
            after_tick=lambda session: accounts.update(last=session.record.deadlines),
        )
    except RtControllerError as error:
        return ComparedDrive(*names, failure=str(error))._asdict(), None
    true = {figure.name: figure.value for figure in drive.car_figures}
    jerk, account, (name, course, _) = jerk_of(drive), accounts["last"], names
    failure = "" if drive.ending in REGULAR else drive.ending
    if drive.stop_s is not None:
        failure = f"safe stop at {drive.stop_s:.1f} s: {StopCause[drive.stop_cause].value}"
    row = ComparedDrive(
        name,
        course,
        seed,
        **{figure: float(true[figure]) for figure in TRUE_FIGURES},
        wheel_rate_rms_degps=wheel_rate_rms_degps(drive),
        lateral_jerk_rms_mps3=jerk.lateral_mps3,
        jerk_rms_mps3=jerk.along_mps3,
        step_p50_us=account.percentiles("cpu_us").p50,
        step_p99_us=account.percentiles("cpu_us").p99,
        work_p50_us=account.percentiles("cpu_us").p50 + account.percentiles("preparation_us").p50,
        stop_s=drive.stop_s,
        failure=failure,
    )
    return row._asdict(), pack_drive(drive)
