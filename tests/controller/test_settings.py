"""Settings made in Python: every refused field is named as Python names it."""

import re
from pathlib import Path
from typing import Any, get_args

import can
import numpy as np
import pytest

from rt_controller import Controller, ControllerConfig, MpcSettings
from rt_controller.bus import transport
from rt_controller.config import ShippedModel, Tolerances
from rt_controller.contract.errors import ConfigError, RtControllerError
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.settings import (
    BusSettings,
    CarSettings,
    CommonInterface,
    ShippedCar,
    ShippedScenario,
)
from rt_controller.settings_table import Settings
from sim_bridge.toml_file import shipped_names


@pytest.mark.parametrize(
    ("table", "values", "expected"),
    [
        (MpcSettings, {"horizon": 1}, "MpcSettings.horizon: expected at least 3, found 1."),
        (MpcSettings, {"horizont": 9}, "horizont: no such setting (did you mean horizon?)."),
        (MpcSettings, {"heading": "yaw"}, "heading: expected 'course' or 'epsi', found 'yaw'."),
        (
            ControllerConfig,
            {"mpc": {"tolerance": {"ey_m": 0}}},
            "mpc.tolerance.ey_m: expected at least",
        ),
        (
            CarSettings,
            {"car": 4},
            "CarSettings.car: expected 'c_class_150kw_awd', 'c_class_125kw_fwd', "
            "'c_class_150kw_bev' or 'commonroad_vehicle_2', or a text, found 4.",
        ),
        (
            ControllerConfig,
            {"model": 5},
            "expected 'mdk-net', 'mdk-net-paper' or 'lti', or a text, or a path, found 5.",
        ),
        (
            BusSettings,
            {"bus": "socketcan", "bus_option": {"fd": True}},
            "BusSettings.bus_option.fd: expected a text, found True.",
        ),
    ],
)
def test_a_refused_field_is_named_with_what_was_expected_and_found(
    table: type[Settings], values: dict[str, Any], expected: str
) -> None:
    with pytest.raises(ConfigError, match=re.escape(expected)):
        table(**values)


def test_all_refused_fields_are_named_at_once_each_in_one_line() -> None:
    with pytest.raises(ConfigError) as refused:
        ControllerConfig(model=5, mpc={"horizon": 1, "knots": "x"})  # type: ignore[arg-type]
    lines = str(refused.value).splitlines()
    names = ["ControllerConfig.model", "ControllerConfig.mpc.horizon", "ControllerConfig.mpc.knots"]
    assert len(lines) == 3
    assert all(line.startswith(name) for line, name in zip(lines, names, strict=True))


def test_an_error_raised_in_python_names_no_option() -> None:
    tolerance = Tolerances(throttle_change=np.inf, brake_change_n=np.inf, steer_change_deg=np.inf)
    config = ControllerConfig(mpc=MpcSettings(tolerance=tolerance))
    with pytest.raises(RtControllerError, match=r"`mpc\.tolerance`") as refused:
        Controller.load("mdk-net", config)
    assert "--" not in str(refused.value)


def test_the_choices_in_the_help_are_what_is_shipped() -> None:
    models = {folder.name for folder in shipped_model().parent.iterdir()}
    assert set(get_args(ShippedModel)) == models
    assert set(get_args(ShippedScenario)) == set(shipped_names("scenarios"))
    assert set(get_args(ShippedCar)) == set(shipped_names("cars"))
    assert get_args(CommonInterface) == transport.COMMON
    assert set(transport.COMMON) <= {*can.VALID_INTERFACES, "remote"}


@pytest.mark.parametrize("name", ["road.xodr", "road.xodr#5,-7", "drive.toml"])
def test_scenario_files_of_all_kinds_are_accepted(tmp_path: Path, name: str) -> None:
    (tmp_path / name.partition("#")[0]).touch()
    assert CarSettings(scenario=str(tmp_path / name)).scenario.endswith(name)


@pytest.mark.parametrize(
    ("model", "given", "horizon", "heading"),
    [
        ("mdk-net", {}, 40, "course"),
        ("mdk-net", {"preset": "paper"}, 20, "epsi"),
        ("mdk-net", {"preset": "paper", "horizon": 30}, 30, "epsi"),
        ("lti", {}, 20, "epsi"),
        ("lti", {"preset": "course"}, 40, "course"),
    ],
)
def test_a_preset_sets_what_is_not_given(
    model: str, given: dict[str, Any], horizon: int, heading: str
) -> None:
    found = MpcSettings(**given).for_model(load_bundle(shipped_model(model)))
    assert (found.horizon, found.heading) == (horizon, heading)
