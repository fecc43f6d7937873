"""`python -m benchmarks.stopping`: starts, stops and holds of the shipped models."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from math import degrees, isnan, nan
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import cyclopts
import numpy as np

from rt_controller.contract.figures import write_figures
from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import PERIOD_S
from rt_controller.drive.table import Drive
from rt_controller.report.table import NO_VALUE, Column, Table, to_markdown
from rt_controller.simulation import simulate
from sim_bridge.scenario import Scenario, parse_scenario

MODELS = ("mdk-net", "lti")
DECELERATIONS_MPS2 = {0.85: (1.0, 1.8, 2.5), 0.3: (1.0, 1.4, 1.8)}
"""of the stops, by road friction"""
CRUISE_MPS = 60.0 / 3.6
CONSTANT_KMH = (15.0, 20.0, 25.0, 32.0, 36.0)
"""in the lowest gears, around the speeds at which the law changes"""
SLOW_MPS = 10.0
"""the changes of the pedal below this speed are counted"""


class Figures(NamedTuple):
    """Of one drive; NaN where there is no stop."""

    model: str
    manoeuvre: str
    friction: float
    stop_error_m: float
    """distance of the standing car from its target"""
    creep_m: float
    """change of place while held"""
    wheel_deg: float
    """change of the steering wheel while held"""
    mode_changes: int
    pedal_changes: int
    """from throttle to brake and back, below `SLOW_MPS`"""
    speed_rms_mps: float
    """against the reference"""
    ey_peak_m: float
    final_mps: float


def start(friction: float) -> Scenario:
    """From a standstill to 50 km/h in 10 s, after 2 s at rest."""
    speed = {"t_s": [0.0, 2.0, 12.0], "value": [0.0, 0.0, 50.0]}
    return _scenario("start", 15.0, friction, {"reference": {"speed_kmh": speed}})


def constant(speed_kmh: float, friction: float) -> Scenario:
    """A constant speed for 15 s."""
    return _scenario("constant", 15.0, friction, {"reference": {"speed_kmh": speed_kmh}})


def stop_and_go(deceleration_mps2: float, friction: float) -> Scenario:
    """Brake from 60 km/h to a target, hold for 10 s, accelerate to 60 km/h."""
    braking_m = CRUISE_MPS**2 / 2.0 / deceleration_mps2
    braking_s = CRUISE_MPS / deceleration_mps2
    stop = {
        "at_s_m": 50.0 + braking_m,
        "hold_s": 10.0,
        "deceleration_mps2": deceleration_mps2,
        "acceleration_mps2": 1.5,
    }
    parts = {
        "reference": {"speed_kmh": 60.0},
        "stops": [stop],
        "metrics": ["stop_error_m", "creep_m", "hold_steer_rad"],
    }
    return _scenario("stop and go", 29.0 + braking_s, friction, parts)


def _scenario(name: str, duration_s: float, friction: float, parts: dict[str, Any]) -> Scenario:
    head = {"format": 2, "name": name, "duration_s": duration_s, "road": {"friction": friction}}
    return parse_scenario({**head, **parts}, name)


def measure(model: str, manoeuvre: str, scenario: Scenario, friction: float) -> Figures:
    """The figures of one drive."""
    drive = simulate(scenario, model=model)
    of_car = {figure.name: figure.value for figure in drive.car_figures}
    return Figures(
        model,
        manoeuvre,
        friction,
        of_car.get("stop_error_m", nan),
        of_car.get("creep_m", nan),
        degrees(of_car.get("hold_steer_rad", nan)),
        sum(a is not b for a, b in pairwise(drive.modes)),
        _pedal_changes(drive),
        drive.errors.vx_rms_mps,
        drive.errors.ey_peak_m,
        _last_driven_mps(drive),
    )


def _pedal_changes(drive: Drive) -> int:
    pedal = np.sign(drive["throttle"] / 1.0 - drive["brake_n"] / 150.0)
    pressed = pedal[(pedal != 0.0) & (drive["vx_mps"] < SLOW_MPS)]
    return int(np.count_nonzero(np.diff(pressed)))


def _last_driven_mps(drive: Drive) -> float:
    is_driven = np.array([mode is not Mode.STANDBY for mode in drive.modes])
    return float(drive["vx_mps"][is_driven][-1])


app = cyclopts.App(name="python -m benchmarks.stopping", version_flags=[])


def drives(model: str) -> Iterator[Figures]:
    """Of all manoeuvres."""
    for friction, decelerations in DECELERATIONS_MPS2.items():
        for speed_kmh in CONSTANT_KMH:
            scenario = constant(speed_kmh, friction)
            yield measure(model, f"{speed_kmh:g} km/h", scenario, friction)
        yield measure(model, "start", start(friction), friction)
        for deceleration in decelerations:
            scenario = stop_and_go(deceleration, friction)
            yield measure(model, f"stop with {deceleration} m/s²", scenario, friction)


@app.default
def main(
    *,
    models: tuple[str, ...] = MODELS,
    json_file: Annotated[Path | None, cyclopts.Parameter(name="--json")] = None,
) -> int:
    """Drive low speeds; standstill to 50 km/h; 60 km/h, stop, hold for 10 s, go.

    In simulated time. The table is in Markdown, as in docs/benchmarks.md.

    Args:
        models: shipped models, or folders of bundles.
        json_file: write the figures to this JSON file.
    """
    by_model = {model: list(drives(model)) for model in models}
    print(to_markdown(_table(by_model)))
    rows = [row._asdict() for found in by_model.values() for row in found]
    write_figures(json_file, {"period_s": PERIOD_S, "drives": rows})
    return 0


def _table(by_model: Mapping[str, Sequence[Figures]]) -> Table:
    """One row for a manoeuvre, three columns for a model."""
    columns = [Column("manoeuvre", is_text=True), Column("friction")]
    for model in by_model:
        columns += [
            Column(f"`{Path(model).name}`: stop and creep (mm), wheel (deg)"),
            Column("modes, pedals"),
            Column("speed RMS", "m/s"),
        ]
    rows = []
    for drives in zip(*by_model.values(), strict=True):
        cells = [drives[0].manoeuvre, f"{drives[0].friction:g}"]
        for drive in drives:
            stop_mm, creep_mm = 1e3 * drive.stop_error_m, 1e3 * drive.creep_m
            cells += [
                NO_VALUE
                if isnan(stop_mm)
                else f"{stop_mm:.0f}, {creep_mm:.0f}, {drive.wheel_deg:.1f}",
                f"{drive.mode_changes}, {drive.pedal_changes}",
                f"{drive.speed_rms_mps:.2f}",
            ]
        rows.append(tuple(cells))
    return Table("", tuple(columns), tuple(rows))


if __name__ == "__main__":
    sys.exit(app())
