"""The rivals by their names, each with the weights or gains that the search found."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

from benchmarks.rivals.bicycle import Bicycle
from benchmarks.rivals.ltv_mpc import BicycleMpc
from benchmarks.rivals.stanley import Gains, Stanley
from rt_controller import ControllerConfig, Drive
from rt_controller.config import MpcSettings, Tolerances
from rt_controller.control.mpc import Mpc
from rt_controller.settings import CarSettings
from rt_controller.simulation import drive_in_lockstep
from sim_bridge.scenario import Scenario

STANLEY, LTV = "stanley", "bicycle-mpc"
TUNED = (STANLEY, LTV)
"""rivals with a result of `python -m benchmarks.tuning`, in a file of their name"""
Values = Mapping[str, float]


def settings_of(values: Values) -> MpcSettings:
    """Settings with these tolerances and other fields by their names."""
    tolerances = {k: v for k, v in values.items() if k in Tolerances.model_fields}
    others: dict[str, Any] = {k: v for k, v in values.items() if k not in tolerances}
    return MpcSettings(tolerance=Tolerances(**tolerances), **others)


def tuned_values(name: str) -> dict[str, float]:
    """What `python -m benchmarks.tuning` found for a rival."""
    text = Path(__file__).with_name(f"{name}.json").read_text(encoding="utf-8")
    return cast("dict[str, float]", json.loads(text)["values"])


def build_rival(name: str, values: Values) -> Mpc:
    """The rival, with all methods that the loop calls."""
    if name == STANLEY:
        return cast("Mpc", Stanley(Bicycle(1), Gains(**values)))
    settings = settings_of(values)
    return BicycleMpc(Bicycle(settings.horizon), settings)


def drive_with(mpc: Mpc, scenario: Scenario, plant: str = "own") -> Drive:
    """A drive with a rival; the low-speed law gets its pedal gains from the bicycle."""
    car = CarSettings(plant=plant)
    return drive_in_lockstep(ControllerConfig(), Bicycle(1).bundle(), mpc, car, scenario=scenario)
