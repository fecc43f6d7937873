"""Scenario files of format 1: their meaning, and what is refused with the names of the fields."""

from pathlib import Path

import numpy as np
import pytest

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.preview import REACH_S
from sim_bridge.scenario import load_scenario
from sim_bridge.scenario.lateral import Moves

GOOD = """
name = "one move"
speed_kmh = 72.0
curvature_per_m = 0.0
duration_s = 4.0
road_friction = 0.85
[[moves]]
start_m = 10.0
length_m = 40.0
to_m = 2.0
"""


def write(tmp_path: Path, text: str) -> str:
    path = tmp_path / "scenario.toml"
    path.write_text(text)
    return str(path)


def test_the_double_lane_change_is_that_of_the_paper() -> None:
    scenario = load_scenario("double_lane_change")
    assert scenario.start.speed_mps == pytest.approx(80 / 3.6)
    assert scenario.road.curvature_per_m.at(50.0) == 0.001
    assert scenario.ticks == 400
    lateral = scenario.ey_m(np.linspace(0.0, 220.0, 500))
    assert lateral.max() == pytest.approx(3.5)
    assert lateral[0] == lateral[-1] == 0.0
    assert isinstance(scenario.lateral, Moves)
    assert all(move.length_m >= 50.0 for move in scenario.lateral.moves)


def test_the_cubic_is_exact_at_the_car_and_close_over_the_preview() -> None:
    scenario = load_scenario("double_lane_change")
    sigma = np.linspace(0.0, REACH_S * scenario.start.speed_mps, 50)
    for s_m in np.arange(0.0, 200.0, 1.7):
        path = scenario.path_ahead(s_m, scenario.start.speed_mps)
        assert path.c0_m == pytest.approx(float(scenario.ey_m(np.array([s_m]))[0]))
        cubic = path.c0_m + sigma * (path.c1 + sigma * (path.c2_per_m + sigma * path.c3_per_m2))
        wanted, is_near = scenario.ey_m(s_m + sigma), sigma <= 0.4 * sigma[-1]
        np.testing.assert_allclose(cubic[is_near], wanted[is_near], atol=0.01)
        np.testing.assert_allclose(cubic, wanted, atol=0.15)


def test_the_values_of_a_file_are_those_of_the_scenario(tmp_path: Path) -> None:
    scenario = load_scenario(write(tmp_path, GOOD))
    assert scenario.name == "one move"
    assert isinstance(scenario.lateral, Moves)
    assert scenario.lateral.moves[0].to_m == 2.0
    assert scenario.ticks == 160


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("speed_kmh = 72.0", "speed_kmh = -1.0", "speed_kmh: expected at least 0.36 .*found -1"),
        ("speed_kmh = 72.0", "speed_kmh = 0", "speed_kmh: expected at least 0.36 .*format = 2"),
        ("speed_kmh = 72.0", "speed_kmh = 251.0", "at most 250 km/h, found 251"),
        ("speed_kmh = 72.0", "speed_kmh = nan", "speed_kmh: expected"),
        ("speed_kmh = 72.0", "speed_kph = 72.0", "speed_kph: no such .* \\(did you mean speed_kmh"),
        ("duration_s = 4.0", "duration_s = 0.0", "duration_s"),
        ("duration_s = 4.0", "", "duration_s"),
        ("length_m = 40.0", "length_m = 0.0", "length_m"),
        ("length_m = 40.0", "length_m = 5.0", "slope"),
        ("road_friction = 0.85", "road_friction = 0.0", "road_friction"),
        ("curvature_per_m = 0.0", "curvature_per_m = 1.0", "curvature_per_m"),
        ("name =", "name", "scenario"),
    ],
)
def test_a_field_out_of_its_limits_is_refused_by_name(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        load_scenario(write(tmp_path, GOOD.replace(old, new)))


def test_moves_must_not_overlap(tmp_path: Path) -> None:
    second = "[[moves]]\nstart_m = 30.0\nlength_m = 40.0\nto_m = 0.0\n"
    with pytest.raises(ConfigError, match="overlap"):
        load_scenario(write(tmp_path, GOOD + second))


def test_all_errors_of_a_file_are_reported_at_once(tmp_path: Path) -> None:
    text = GOOD.replace("72.0", "0.0").replace("length_m = 40.0", "length_m = 0.0")
    with pytest.raises(ConfigError) as refused:
        load_scenario(write(tmp_path, text))
    assert "speed_kmh: expected at least 0.36 and at most 250 km/h, found 0." in str(refused.value)
    assert "moves[0].length_m: expected more than 0.0, found 0.0" in str(refused.value)


def test_moves_beyond_the_grip_of_the_road_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"moves: expected a lateral acceleration below the grip"):
        load_scenario(write(tmp_path, GOOD.replace("road_friction = 0.85", "road_friction = 0.1")))


def test_an_unknown_scenario_is_refused_with_the_list_of_shipped_ones() -> None:
    with pytest.raises(ConfigError, match="double_lane_change"):
        load_scenario("tripple_lane_change")
