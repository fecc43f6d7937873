"""The benchmark of starts and stops: figures of each drive, and one row for a manoeuvre."""

import json
import math
from pathlib import Path

import pytest

from benchmarks import stopping
from sim_bridge.scenario import parse_scenario

STOP = {
    "format": 2,
    "name": "short stop",
    "duration_s": 4.0,
    "reference": {"speed_kmh": 9.0},
    "stops": [{"at_s_m": 4.0, "hold_s": 5.0, "deceleration_mps2": 1.5}],
    "metrics": ["stop_error_m", "creep_m", "hold_steer_rad"],
}


def test_the_manoeuvres_have_their_target_and_speed() -> None:
    scenario = stopping.stop_and_go(2.0, 0.3)
    (stop,) = scenario.stops
    assert stop.hold_s == 10.0
    assert scenario.reference_speed_mps(0.0, 0.0) == pytest.approx(60.0 / 3.6)
    before_m = stop.at_s_m - 4.0  # v = sqrt(2 b d)
    assert scenario.reference_speed_mps(before_m, 0.0) == pytest.approx(4.0)
    assert scenario.road.friction_left.at(0.0) == 0.3
    started = stopping.start(0.85)
    assert started.reference_speed_mps(0.0, 1.9) == 0.0
    assert started.reference_speed_mps(0.0, 12.0) == pytest.approx(50.0 / 3.6)


def test_the_figures_of_a_stop_are_those_of_the_drive() -> None:
    found = stopping.measure("lti", "short stop", parse_scenario(STOP, "test"), 0.85)
    assert abs(found.stop_error_m) < 0.2
    assert abs(found.creep_m) < 0.05
    assert found.wheel_deg < 1.0
    assert found.mode_changes >= 2  # low speed, standstill, STANDBY
    assert found.final_mps < 0.05


def test_the_table_has_a_row_for_a_manoeuvre_and_the_file_every_figure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def drives(model: str) -> list[stopping.Figures]:
        of_start = (math.nan, math.nan, math.nan, 2, 0, 0.151, 0.0, 13.9)
        of_stop = (-0.031, 0.004, 0.02, 5, 3, 0.2, 0.01, 0.0)
        return [
            stopping.Figures(model, "start", 0.85, *of_start),
            stopping.Figures(model, "stop with 1.0 m/s²", 0.85, *of_stop),
        ]

    monkeypatch.setattr(stopping, "drives", drives)
    figures_file = tmp_path / "figures.json"
    models = ("--models", "mdk-net", "--models", "./lti")
    with pytest.raises(SystemExit) as ended:
        stopping.app([*models, "--json", str(figures_file)])
    assert ended.value.code == 0
    head, _, start, stop = capsys.readouterr().out.splitlines()
    assert "| `mdk-net`: stop and creep (mm), wheel (deg) | " in head
    assert "| `lti`: " in head
    assert start == "| start | 0.85" + " | – | 2, 0 | 0.15" * 2 + " |"
    assert stop == "| stop with 1.0 m/s² | 0.85" + " | -31, 4, 0.0 | 5, 3 | 0.20" * 2 + " |"
    figures = json.loads(figures_file.read_text())
    assert [drive["model"] for drive in figures["drives"]] == ["mdk-net"] * 2 + ["./lti"] * 2
