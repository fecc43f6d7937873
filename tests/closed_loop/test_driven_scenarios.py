"""Driven scenarios: those that ship against their own limits; cones, lengths, limits of others."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from kinematic_plant import KinematicCar

from rt_controller import Bundle, cli, simulate
from rt_controller.car_figures import EXIT_LIMIT, limits_missed
from rt_controller.contract.artifact import load_bundle, shipped_model
from rt_controller.contract.signals import Mode
from sim_bridge import parse_scenario
from sim_bridge.scenario import load_scenario, shipped_scenarios

EXPECTED_MISSES = {
    # The path needs about 90 deg of the steering wheel, its bound is 40 deg.
    "iso_3888_2": ["cone_hits", "lane_margin_m"],
}
DRIVING = {Mode.STANDBY, Mode.NOMINAL, Mode.LOW_SPEED, Mode.STANDSTILL}
LONGEST_S = 15.0
"""of a scenario that is driven with every change"""


def shipped() -> list[Any]:
    """All shipped scenarios; those that last longer are left to the slow tests."""
    slow = pytest.mark.nightly
    return [
        pytest.param(name, marks=slow if load_scenario(name).duration_s > LONGEST_S else ())
        for name in shipped_scenarios()
    ]


@pytest.fixture(scope="module")
def lti() -> Bundle:
    return load_bundle(shipped_model("lti"))


@pytest.mark.parametrize("name", shipped())
def test_a_shipped_scenario_is_driven_within_its_own_limits(name: str) -> None:
    driven = simulate(name, model="mdk-net")
    assert limits_missed(driven.car_figures) == EXPECTED_MISSES.get(name, [])
    assert set(driven.modes) <= DRIVING
    assert driven.ending == "the mission is over"


def test_a_scenario_built_in_python_is_driven_and_judged(lti: Bundle) -> None:
    content = {
        "format": 2, "name": "built", "duration_s": 2.0, "reference": {"speed_kmh": 60.0},
        "metrics": ["speed_peak_mps"], "limits": {"ey_peak_m": 0.05},
    }  # fmt: skip
    driven = simulate(parse_scenario(content, "built"), model=lti, plant=KinematicCar())
    assert [figure.name for figure in driven.car_figures] == ["ey_peak_m", "speed_peak_mps"]
    assert driven.car_figures[0].is_kept


def test_a_missed_limit_is_an_exit_code_of_the_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    summary, scenario = tmp_path / "drive.json", tmp_path / "off.toml"
    scenario.write_text(
        'format = 2\nname = "off"\nduration_s = 0.5\ninitial.ey_m = 0.2\n'
        "reference.speed_kmh = 60.0\nlimits.ey_peak_m = 0.1\n"
    )
    options = "--bus virtual --pace lockstep --quiet --model lti"
    files = ("--json", str(summary), "--scenario", str(scenario))
    for stop, code in (((), EXIT_LIMIT), (("--duration-s", "0.2"), 0)):
        monkeypatch.setattr("sys.argv", ["rt-controller", *options.split(), *files, *stop])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert ended.value.code == code
        assert json.loads(summary.read_text())["limits_missed"] == ["ey_peak_m"]


def test_place_cones_and_time_at_the_limit_of_the_wheel_are_of_the_drive(lti: Bundle) -> None:
    pytest.importorskip("matplotlib")
    content = {
        "format": 2, "name": "too tight", "duration_s": 3.0, "initial": {"s_m": 50.0},
        "road": {"curvature_per_m": 0.025},
        "reference": {"speed_kmh": 40.0, "ey_m": {
            "kind": "slalom", "start_s_m": 10.0, "spacing_m": 30.0, "cones": 2}},
    }  # fmt: skip
    driven = simulate(parse_scenario(content, "tight"), model=lti, plant=KinematicCar())
    assert driven["s_m"][0] == 50.0
    np.testing.assert_allclose(np.diff(driven["s_m"])[1:-1], driven["ds_m"][2:-1], atol=1e-9)
    assert driven.at_limit_s.steer_rad > 2.0
    assert driven.at_limit_s.brake_n == 0.0
    position = driven.plot().axes[0]
    cones = next(line for line in position.lines if line.get_label() == "cones")
    reached_s = np.interp(55.0, driven["s_m"], driven["time_s"])
    assert np.asarray(cones.get_xdata()) == pytest.approx([reached_s])


def test_a_drive_ends_where_its_road_ends(lti: Bundle) -> None:
    content = {
        "format": 2, "name": "short", "duration_s": 60.0, "reference": {"speed_kmh": 60.0},
        "road": {"length_m": 30.0},
    }  # fmt: skip
    driven = simulate(parse_scenario(content, "short"), model=lti, plant=KinematicCar())
    assert driven["time_s"][-1] == pytest.approx(30.0 / (60.0 / 3.6), abs=0.3)
