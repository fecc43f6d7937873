"""Drives in simulated time: every controller in every row of one list."""

import runpy
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import chdir, redirect_stdout
from dataclasses import replace
from functools import partial
from io import StringIO
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from benchmarks.figures.results import Figures, Part
from rt_controller import Drive, simulate
from rt_controller.controllers import BASELINES
from rt_controller.drive.comfort import wheel_rate_rms_degps
from sim_bridge.faults.fault import Fault
from sim_bridge.faults.sensors import sensor_noise
from sim_bridge.scenario import Scenario, load_scenario
from sim_bridge.scenario.scenario import Load

ROOT = Path(__file__).parents[2]
MODELS = ("mdk-net", "mdk-net-small", "mdk-net-paper", "lti")
RIVALS = tuple(BASELINES)
_TRUE = ("ey_rms_m", "ey_peak_m", "epsi_peak_rad", "speed_rms_mps", "speed_peak_mps")
"""figures that are measured at the car, not on the bus"""
_OF_STOP = ("stop_error_m", "creep_m", "hold_steer_rad")
_SLOW_MPS = 10.0
"""the changes of the pedal below this speed are counted"""
_MASS_20_PERCENT_KG = 300.0
_NOISE_SEED = 4


class Row(NamedTuple):
    """One drive of the tables."""

    name: str
    scenario: str
    """a shipped one, or a file relative to the repository"""
    conditions: Mapping[str, Any] = MappingProxyType({})
    """what differs from the scenario; keys as in `scenario_of`, and `plant`"""
    settled_s: float = 0.0
    """length of the end of the drive in which the lateral error has settled; 0: it does not"""
    has_stop: bool = False
    changes_speed: bool = False
    """the error of the speed counts as much as the lateral one"""


class Controller(NamedTuple):
    """Something that drives a scenario on a plant."""

    drive: Callable[..., Drive]
    """of a scenario and the name of a `plant`, as `simulate`"""
    models: tuple[str, ...] = ()
    """shipped models that it uses"""
    rows: Sequence[str] | None = None
    """the rows that it drives; None: all"""


_NOISE = {"sensor_noise_seed": _NOISE_SEED}
_WET_AND_HEAVY = {"friction": 0.6, "mass_kg": _MASS_20_PERCENT_KG}
_FAST_SINE = "sine of 0.7 Hz, 80 km/h"
_LANE_CHANGES = {60: "lane_change_60", 80: "double_lane_change", 120: "lane_change_120"}
ROWS = (
    *(Row(f"lane change, {v} km/h", name) for v, name in _LANE_CHANGES.items()),
    Row("lane change over 38 m, 80 km/h", "benchmarks/scenarios/hard_lane_change.toml"),
    Row("slalom", "slalom"),
    Row("sine, 60 km/h", "sine_60"),
    Row("sine, 110 km/h", "sine_110"),
    Row("step of curvature", "curvature_step"),
    Row("step of curvature, no preview", "curvature_step", {"has_preview": False}),
    Row("road course", "road_course"),
    Row("road course, no preview", "road_course", {"has_preview": False}),
    Row("bend of 100 m, 60 km/h", "benchmarks/scenarios/bend_100m.toml", settled_s=8.0),
    Row("bend of 200 m, 80 km/h", "benchmarks/scenarios/bend_200m.toml", settled_s=8.0),
    Row("bend of 60 m, 45 km/h", "benchmarks/scenarios/bend_60m.toml", settled_s=5.0),
    *(
        Row(
            f"bend of {radius_m} m to the {side}, {speed_kmh} km/h",
            f"benchmarks/scenarios/bend_{radius_m}m.toml",
            {"is_mirrored": side == "right"},
        )
        for radius_m, speed_kmh in ((40, 45), (20, 32))
        for side in ("left", "right")
    ),
    Row("S-bends of 150 m, 90 km/h", "benchmarks/scenarios/s_bends.toml"),
    *(
        Row(name, f"benchmarks/scenarios/{file}.toml", changes_speed=True)
        for name, file in (
            ("bend of 400 m, 50 to 110 km/h", "accelerating_bend"),
            ("grade of 10 %, 110 to 70 km/h", "slower_uphill"),
        )
    ),
    Row(_FAST_SINE, "benchmarks/scenarios/fast_sine.toml"),
    Row("bank of 6 %, 80 km/h", "benchmarks/scenarios/bank.toml", settled_s=5.0),
    Row("side wind of 15 m/s, 80 km/h", "benchmarks/scenarios/side_wind.toml", settled_s=5.0),
    Row("braking on split friction", "split_friction"),
    Row("stop and go", "stop_and_go"),
    Row("standstill to 50 km/h", "launch_50"),
    *(
        Row(
            f"stop with {deceleration} m/s², friction {friction}",
            "benchmarks/scenarios/stop.toml",
            {"deceleration_mps2": deceleration, "friction": friction},
            has_stop=True,
        )
        for friction, decelerations in ((0.85, (1.0, 1.8, 2.5)), (0.3, (1.0, 1.4, 1.8)))
        for deceleration in decelerations
    ),
    Row("lane change, 80 km/h, friction 0.6, mass +20 %", "double_lane_change", _WET_AND_HEAVY),
    *(
        Row(f"lane change, {v} km/h, sensor noise", name, _NOISE)
        for v, name in _LANE_CHANGES.items()
    ),
    *(
        Row(f"lane change, 80 km/h, CommonRoad vehicle {i}", "double_lane_change", {"plant": plant})
        for i, plant in ((i, f"commonroad:{i}") for i in (1, 2, 3))
    ),
)


def _drive_with_example(scenario: Scenario, plant: str) -> Drive:
    """With the bundle of examples/linear_model.py."""
    # The example drives, saves its bundle and prints its errors.
    with tempfile.TemporaryDirectory() as folder, chdir(folder), redirect_stdout(StringIO()):
        bundle = runpy.run_path(str(ROOT / "examples" / "linear_model.py"))["bundle"]
    return simulate(scenario, model=bundle, plant=plant)


_MOVING = tuple(row.name for row in ROWS if not row.has_stop)
"""where the law of low speeds, which all controllers share, does not decide"""
CONTROLLERS = {
    **{model: Controller(partial(simulate, controller=model), (model,)) for model in MODELS},
    "linear_model.py": Controller(_drive_with_example, rows=("lane change, 80 km/h",)),
    **{name: Controller(partial(simulate, controller=name), rows=_MOVING) for name in RIVALS},
}


def parts() -> Iterator[Part]:
    """A drive of every row with every controller."""
    for name, controller in CONTROLLERS.items():
        for row in ROWS:
            if controller.rows is None or row.name in controller.rows:
                measure = partial(measure_drive, controller, row)
                yield Part(part_name(name, row.name), controller.models, measure)


def part_name(controller: str, row: str) -> str:
    return f"{controller}: {row}"


def measure_drive(controller: Controller, row: Row) -> Figures:
    """Errors of the car, from its own truth, and the motion of the steering wheel."""
    drive = controller.drive(scenario_of(row), plant=row.conditions.get("plant", "own"))
    truth = {figure.name: figure.value for figure in drive.car_figures}
    is_driven = np.array([mode.drives for mode in drive.modes])
    figures: Figures = {
        **truth,
        "wheel_rate_rms_degps": wheel_rate_rms_degps(drive),
        "steer_at_limit_s": drive.at_limit_s.steer_rad,
        "stop_s": drive.stop_s,
    }
    if row.settled_s:
        is_settled = is_driven & (drive["time_s"] > drive["time_s"][is_driven][-1] - row.settled_s)
        offset_m = (drive["ey_m"] - drive["path_ey_m"])[is_settled]
        figures["ey_settled_m"] = float(np.nanmean(offset_m))
    if row.has_stop:
        pedal = np.sign(drive["throttle"] - drive["brake_n"] / 150.0)
        pressed = pedal[(pedal != 0.0) & (drive["vx_mps"] < _SLOW_MPS)]
        figures["pedal_changes"] = int(np.count_nonzero(np.diff(pressed)))
        figures["mode_changes"] = sum(a is not b for a, b in pairwise(drive.modes))
    return {
        name: float(f"{value:.5g}") if isinstance(value, float) else value
        for name, value in figures.items()
    }


def scenario_of(row: Row) -> Scenario:
    """The scenario of a row with its conditions, without limits of its own."""
    path = row.scenario
    scenario = load_scenario(str(ROOT / path) if path.endswith(".toml") else path)
    conditions = row.conditions
    if "friction" in conditions:
        scenario = scenario.with_friction(conditions["friction"])
    if conditions.get("is_mirrored"):
        curvature = scenario.road.curvature_per_m
        mirrored = replace(curvature, coefficients=-curvature.coefficients)
        road = scenario.road.model_copy(update={"curvature_per_m": mirrored})
        scenario = replace(scenario, road=road)
    if "mass_kg" in conditions:
        scenario = replace(scenario, payload=Load.model_construct(mass_kg=conditions["mass_kg"]))
    if "deceleration_mps2" in conditions:
        (stop,) = scenario.stops
        stops = (stop.model_copy(update={"deceleration_mps2": conditions["deceleration_mps2"]}),)
        scenario = replace(scenario, stops=stops)
    if "sensor_noise_seed" in conditions:
        rng = np.random.default_rng(conditions["sensor_noise_seed"])
        scenario = replace(scenario, faults=tuple(sensor_noise(rng)))
    if not conditions.get("has_preview", True):
        scenario = replace(scenario, faults=(Fault(kind="preview_lost"),))
    return replace(scenario, metrics=_TRUE + _OF_STOP * row.has_stop, limits={})
