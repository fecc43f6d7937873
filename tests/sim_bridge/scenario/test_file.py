"""Scenario files of format 2: what is refused, with the names of the fields."""

from copy import deepcopy
from math import radians
from pathlib import Path
from typing import Any

import pytest

from rt_controller.contract.errors import ConfigError
from sim_bridge.scenario import Scenario, load_scenario, parse_scenario

GOOD: dict[str, Any] = {
    "format": 2,
    "name": "good",
    "duration_s": 20.0,
    "initial": {"speed_kmh": 70.0, "s_m": 5.0, "ey_m": 0.2, "epsi_deg": 1.0},
    "road": {
        "curvature_per_m": {"s_m": [0.0, 100.0], "value": [0.0, 0.002]},
        "friction": 0.9,
        "bank_deg": 2.0,
        "grade_percent": {"s_m": [0.0, 50.0], "value": [0.0, 4.0], "interpolation": "pchip"},
        "width_m": 8.0,
    },
    "reference": {"speed_kmh": 72.0, "ey_m": {"s_m": [20.0, 90.0], "value": [0.0, 1.0],
                                              "interpolation": "pchip"}},
    "cross_wind_mps": {"t_s": [0.0, 2.0], "value": [0.0, 8.0]},
    "payload": {"mass_kg": 150.0, "ahead_m": -1.0},
    "stops": [{"at_s_m": 200.0, "hold_s": 2.0}],
    "faults": [{"kind": "state_lost", "start_s": 3.0, "duration_s": 0.05}],
    "metrics": ["creep_m"],
    "limits": {"ey_peak_m": 0.5},
}  # fmt: skip


def changed(path: str, value: Any) -> dict[str, Any]:
    """The good content with another value; None: without the field."""
    content = deepcopy(GOOD)
    *folders, name = (int(part) if part.isdigit() else part for part in path.split("/"))
    table: Any = content
    for folder in folders:
        table = table[folder]
    if value is None:
        del table[name]
    else:
        table[name] = value
    return content


def refusal(content: dict[str, Any]) -> str:
    with pytest.raises(ConfigError) as refused:
        parse_scenario(content, "test")
    return str(refused.value)


def test_the_fields_of_a_file_are_those_of_the_scenario() -> None:
    scenario: Scenario = parse_scenario(GOOD, "test")
    assert scenario.start.speed_mps == pytest.approx(70.0 / 3.6)
    assert scenario.start.epsi_rad == pytest.approx(radians(1.0))
    ground = scenario.road_at(100.0, 2.0)
    assert ground.curvature_per_m == pytest.approx(0.002)
    assert ground.friction_left == ground.friction_right == 0.9
    assert ground.bank_rad == pytest.approx(radians(2.0))
    assert ground.grade_rad == pytest.approx(0.04, abs=1e-4)
    assert ground.wind_left_mps == 8.0
    assert scenario.payload.mass_kg == 150.0
    assert scenario.stops[0].hold_s == 2.0
    assert scenario.faults[0].ticks == range(120, 122)
    assert scenario.limits == {"ey_peak_m": 0.5}


def test_a_file_without_optional_fields_is_a_straight_dry_road() -> None:
    content = {"format": 2, "name": "x", "duration_s": 5.0, "reference": {"speed_kmh": 50.0}}
    ground = parse_scenario(content, "test").road_at(10.0, 0.0)
    assert ground == (0.0, 0.0, 0.85, 0.85, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("format", 3, "format: expected 2, found 3."),
        ("format", None, "format: expected a value, found none."),
        ("name", "", "name: expected a text that is not empty"),
        ("duration_s", 0.0, "duration_s: expected more than 0.0"),
        ("duration_s", True, "duration_s: expected a number, found True"),
        ("road/lenght_m", 3.0, "road.lenght_m: no such setting (did you mean length_m?)"),
        ("stops/0/at_s", 3.0, "stops[0].at_s: no such setting (did you mean at_s_m?)"),
        ("xyzzy", 3.0, "xyzzy: no such setting."),
        ("initial/speed_kmh", 300.0, "initial.speed_kmh: expected at most 250.0"),
        ("reference/speed_kmh", 300.0, "reference.speed_kmh: expected 0..250 km/h, found 300"),
        ("reference/speed_kmh", 0.3, "expected 0 or at least 0.36 km/h, found 0.3"),
        ("reference/speed_kmh", {"t_s": [0.0, 1e308], "value": [50.0, 9.0]}, "t_s[1]: expected"),
        ("road/curvature_per_m", [0.0, 0.01],
         "road.curvature_per_m: expected a number, a table with value and s_m, or kind = circle"),
        ("reference/speed_kmh", {"s_m": [0.0], "value": [50.0], "interpolation": "step"},
         "reference.speed_kmh.interpolation: expected none for a speed over s_m, whose"),
        ("reference/speed_kmh", {"t_s": [0.0], "s_m": [0.0], "value": [50.0]},
         "reference.speed_kmh.s_m: no such setting."),
        ("reference/ey_m", {"kind": "slalom", "start_m": 5.0, "spacing_m": 40.0, "cones": 3},
         "reference.ey_m.start_m: no such setting (did you mean start_s_m?)"),
        ("reference/speed_kmh", {"kind": "warp"}, "reference.speed_kmh: expected a number, a ta"),
        ("reference/speed_kmh", {"s_m": [0.0, 9.0], "value": [0.0, 9.0]}, "cannot leave a stands"),
        ("reference/speed_kmh", {"t_s": [0.0, 1.0], "value": [0.0, 100.0]},
         "below the grip of 8.8 m/s^2, found 27.8"),
        ("reference/speed_kmh", {"t_s": [0.0, 1.0], "value": [50.0]}, "value: expected 2 entries"),
        ("reference/speed_kmh", {"t_s": [1.0, 0.0], "value": [50.0, 9.0]}, "t_s: expected knots"),
        ("reference/speed_kmh", {"value": [50.0]}, "reference.speed_kmh.s_m: expected a value"),
        ("reference", None, "reference: expected a value, found none"),
        ("reference/ey_m", 11.0, "reference.ey_m: expected -10..10 m, found 11"),
        ("reference/ey_m", {"s_m": [20.0, 23.0], "value": [0.0, 3.0]}, "slope of at most 0.5"),
        ("reference/ey_m", {"kind": "sine", "amplitude_m": 1.0}, "ey_m.wavelength_m: expected it"),
        ("reference/ey_m", {"kind": "sine", "amplitude_m": 1.0, "frequency_hz": 0.2},
         "slope of at most 0.5"),
        ("reference/ey_m", {"kind": "iso_3888_1", "start_s_m": 20.0, "clearance_m": 1.0},
         "reference.ey_m.clearance_m: expected lanes"),
        ("reference/ey_m", {"kind": "moves", "moves": [
            {"start_m": 10.0, "length_m": 40.0, "to_m": 1.0},
            {"start_m": 30.0, "length_m": 40.0, "to_m": 0.0}]},
         "ey_m.moves[1].start_m: expected at least 50 (moves must not overlap), found 30."),
        ("reference/ey_m", {"kind": "sine", "amplitude_m": 0.01, "wavelength_m": 1.5},
         "reference.ey_m.wavelength_m: expected at least 2.0, found 1.5"),
        ("reference/ey_m", {"s_m": [20.0, 20.1, 20.2], "value": [0.0, 0.02, 0.0]},
         "reference.ey_m.s_m: expected knots 0.25 m apart or more, found 0.1 m"),
        ("reference/ey_m", 3.5, "stays on its road of road.width_m"),
        ("road/curvature_per_m", 0.2, "road.curvature_per_m: expected -0.15..0.15 1/m"),
        ("road/curvature_per_m", {"kind": "circle", "radius_m": 5.0},
         "road.curvature_per_m.radius_m: expected at least 6.7, found 5"),
        ("road/curvature_per_m", {"kind": "course", "bends": [{"radius_m": 50.0}]},
         "road.curvature_per_m.bends[0].turn_deg: expected together"),
        ("road/curvature_per_m", {"kind": "course", "bends": [
            {"radius_m": 50.0, "turn_deg": 30.0, "spiral_m": 40.0}]},
         "road.curvature_per_m.bends[0].spiral_m: expected at most"),
        ("road/curvature_per_m", {"s_m": [0.0], "value": [0.025]},
         "below the grip of 8.8 m/s^2, found 10.8 m/s^2"),
        ("road/friction", 0.01, "road.friction: expected 0.05..1.5, found 0.01"),
        ("road/friction", {"s_m": [0, 9], "value": [0.5, 2.0]}, "found 2 at 9"),
        ("road/friction_left", 0.5, "road.friction: expected it, or"),
        ("road", {"opendrive": {"file": ""}}, "road.opendrive.file: expected the name of a file"),
        ("road/opendrive", {"file": "a.xodr"}, "bank_deg: expected none beside opendrive"),
        ("road/length_m", 4.0, "initial.s_m: expected less than the length of the road"),
        ("cross_wind_mps", 60.0, "cross_wind_mps: expected -40..40 m/s"),
        ("payload/mass_kg", 2000.0, "payload.mass_kg: expected at most 1000.0"),
        ("stops/0/at_s_m", 20.0, "stops: expected at least the braking distance"),
        ("stops/0/at_s_m", 900.0, "stops: expected places that the drive reaches"),
        ("stops/0/hold_s", -1.0, "stops[0].hold_s: expected at least 0"),
        ("faults/0/kind", "gremlins", "faults[0].kind: expected one of lag, freeze"),
        ("faults/0/delay_s", 0.1, "faults[0].delay_s: expected none for drop"),
        ("faults/0", {"kind": "state_offset", "start_s": 1.0, "duration_s": 1.0},
         "faults[0].signals: expected signals or messages for bias"),
        ("faults/0", {"kind": "state_offset", "start_s": 1.0, "duration_s": 1.0,
                      "signal": "speed", "value": 1.0}, "signals[0]: expected a signal of"),
        ("faults/0/duration_s", 1e-9,
         "faults[0].duration_s: expected at least 1 control periods of 25 ms for drop"),
        ("faults/0/start_s", 20.0,
         "faults[0].start_s: expected less than duration_s, 20 s, found 20"),
        ("metrics", ["beauty"], "metrics[0]: expected one of ey_rms_m"),
        ("limits", {"beauty": 1.0}, "limits.beauty: expected one of ey_rms_m"),
        ("limits", {"ey_peak_m": -0.1}, "limits.ey_peak_m: expected at least 0, found -0.1"),
    ],
)  # fmt: skip
def test_a_field_that_does_not_fit_is_refused_by_name(path: str, value: Any, message: str) -> None:
    text = refusal(changed(path, value))
    assert text.startswith("test:")
    assert message in text


def test_all_errors_of_a_file_are_reported_at_once() -> None:
    content = changed("road/friction", 9.0)
    content["initial"]["ey_m"] = 50.0
    content["stops"][0]["hold_s"] = -1.0
    text = refusal(content)
    for field in ("road.friction:", "initial.ey_m:", "stops[0].hold_s:"):
        assert f"\n  {field}" in text


def test_a_file_that_is_no_toml_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    path.write_text("format = ")
    with pytest.raises(ConfigError, match="expected a TOML file"):
        load_scenario(str(path))


def test_an_unknown_scenario_is_refused_with_the_list_of_shipped_ones() -> None:
    with pytest.raises(ConfigError, match=r"double_lane_change.*did you mean double_lane_chan"):
        load_scenario("dubble_lane_change")


def test_a_wrong_kind_of_fault_hides_none_of_its_other_values() -> None:
    fault = {"kind": "lost", "signal": "ey", "start_s": "3", "duration_s": -1.0}
    with pytest.raises(ConfigError) as refused:
        parse_scenario(
            {"format": 2, "name": "x", "duration_s": 6.0, "reference": {"speed_kmh": 80.0},
             "faults": [fault]}, "test",
        )  # fmt: skip
    for name in ("kind", "signals[0]", "start_s", "duration_s"):
        assert f"faults[0].{name}: expected" in str(refused.value)
