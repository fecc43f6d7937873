"""`sim-bridge validate` from end to end: results, files, exit code."""

import json
from dataclasses import dataclass
from importlib import resources
from math import nan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rt_controller.contract.errors import ConfigError
from sim_bridge.validation import command
from sim_bridge.validation.acceptance import TESTS, Line, check_line
from sim_bridge.validation.command import validate
from sim_bridge.validation.recording.options import RecordingOptions


@dataclass(frozen=True, slots=True)
class ValidationRun:
    exit_code: int
    lines: list[dict[str, Any]]
    html: str


def run_validation(folder: Path, car: str | None) -> ValidationRun:
    page, figures = folder / "page.html", folder / "figures.json"
    code = validate(car=car, html=page, json_file=figures, quick=True)
    return ValidationRun(code, json.loads(figures.read_text("utf-8")), page.read_text("utf-8"))


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> ValidationRun:
    """Each test with the car that its targets belong to."""
    return run_validation(tmp_path_factory.mktemp("table"), None)


@pytest.fixture(scope="module")
def strong_rear(tmp_path_factory: pytest.TempPathFactory) -> ValidationRun:
    """A car whose rear brakes are as strong as its front brakes, without a knee."""
    folder = tmp_path_factory.mktemp("strong_rear")
    file = resources.files("sim_bridge") / "cars" / "c_class_150kw_awd.toml"
    text = file.read_text("utf-8")
    changed = text.replace("rear_nm_per_mpa = { value = 150.0", "rear_nm_per_mpa = { value = 250.0")
    changed = changed.replace("slope_above_knee = { value = 0.3", "slope_above_knee = { value = 1")
    assert changed.count("250.0") == text.count("250.0") + 1
    car = folder / "strong_rear_brakes.toml"
    car.write_text(changed, "utf-8")
    return run_validation(folder, str(car))


def test_every_judged_line_passes(table: ValidationRun) -> None:
    assert [line["name"] for line in table.lines if line["ok"] is False] == []
    assert table.exit_code == 0


def test_the_table_contains_all_tests(table: ValidationRun) -> None:
    assert {line["test"] for line in table.lines} == set(TESTS)


def test_at_least_half_of_the_judged_lines_were_not_fitted(table: ValidationRun) -> None:
    judged = [line for line in table.lines if line["ok"] is not None]
    assert sum(line["fitted"] for line in judged) <= 0.5 * len(judged)


def test_each_target_has_a_source(table: ValidationRun) -> None:
    for line in table.lines:
        assert (line["target"] is None) == (line["source"] is None)


def test_a_known_gap_is_shown_as_missed_and_not_judged(table: ValidationRun) -> None:
    """Public inertia and stiffness do not allow the roll phase of the measured sedan."""
    gaps = [line for line in table.lines if line["name"].startswith("roll phase at 1.")]
    with_target = [line for line in gaps if line["target"] is not None]
    assert len(with_target) == 2
    assert all(line["ok"] is None and line["is_within"] is False for line in with_target)
    assert "missed, not judged" in table.html


def test_the_lines_of_a_car_have_different_names(table: ValidationRun) -> None:
    assert len({(line["car"], line["name"]) for line in table.lines}) == len(table.lines)


def test_a_line_has_target_result_bounds_and_mark(table: ValidationRun) -> None:
    for line in table.lines:
        assert {"test", "car", "name", "unit", "target", "reached", "tolerance", "ok"} <= set(line)
        assert isinstance(line["reached"], float)
        assert (line["target"] is None) == (line["tolerance"] is None)
        if line["ok"] is not None:
            above = line["low"] is None or line["reached"] >= line["low"]
            below = line["high"] is None or line["reached"] <= line["high"]
            assert line["ok"] is (above and below)


def test_both_directions_are_compared_with_the_reference_model(table: ValidationRun) -> None:
    turns = [
        line for line in table.lines if line["test"] == 4 and "version 3.0.2" not in line["name"]
    ]
    yaw_rates = [line["target"] for line in turns if line["name"].startswith("yaw rate")]
    assert len(yaw_rates) == 6
    assert sorted(target > 0.0 for target in yaw_rates) == [False] * 3 + [True] * 3


def test_the_sine_with_dwell_is_reported_and_not_judged(table: ValidationRun) -> None:
    dwell = [line for line in table.lines if line["test"] == 6]
    assert len(dwell) == 3
    assert all(line["ok"] is None and line["target"] is not None for line in dwell)


def test_the_page_has_a_section_for_each_test_and_its_figures(table: ValidationRun) -> None:
    for test in TESTS:
        assert f"<h2>{test} · " in table.html
    assert table.html.count('class="plotly-graph-div"') == 11
    text = table.html.replace("\\u002f", "/")
    for axis in ("steering wheel angle / deg", "yaw rate / (deg/s)", "frequency / Hz", "gear"):
        assert axis in text


def test_the_page_opens_without_a_network(table: ValidationRun) -> None:
    assert "<script src=" not in table.html
    assert "<link" not in table.html


def test_a_car_with_strong_rear_brakes_fails_only_the_line_about_them(
    strong_rear: ValidationRun,
) -> None:
    """The targets of other cars are shown and not judged."""
    missed = [line["name"] for line in strong_rear.lines if line["ok"] is False]
    assert missed == ["brakings in which a rear wheel locks first"]
    assert strong_rear.exit_code == 1


def test_another_car_is_not_judged_by_the_targets_of_the_table(strong_rear: ValidationRun) -> None:
    by_name = {line["name"]: line for line in strong_rear.lines}
    assert by_name["steering effort"]["target"] == 88.0
    assert by_name["steering effort"]["ok"] is None
    assert by_name["steering effort"]["is_within"] is None
    assert by_name["largest difference of the mirrored run"]["ok"] is True
    assert 4 not in {line["test"] for line in strong_rear.lines}


def test_numbers_that_could_not_be_measured_are_null(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    line = Line(name="yaw rate", target="reference", share=0.1)
    results = [check_line(4, line, nan, "c_class_150kw_awd", reference=nan)]
    monkeypatch.setattr(command, "measure_all", lambda *_: SimpleNamespace(results=results))
    figures = tmp_path / "figures.json"
    assert validate(json_file=figures) == 1
    (written,) = json.loads(figures.read_text("utf-8"))
    assert [written[name] for name in ("reached", "target", "low", "high")] == [None] * 4


def test_an_unknown_car_is_refused_by_name() -> None:
    with pytest.raises(ConfigError, match="no_such_car"):
        validate(car="no_such_car")


def test_a_page_that_cannot_be_written_is_refused_before_the_run(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="nowhere"):
        validate(html=tmp_path / "nowhere" / "page.html")


def test_options_of_a_recording_are_refused_without_one() -> None:
    with pytest.raises(ConfigError, match=r"--column, --friction.*--recording"):
        validate(recorded=RecordingOptions(column=("vx_mps=v",), friction=1.0))


def test_a_quick_comparison_with_a_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--quick"):
        validate(quick=True, recorded=RecordingOptions(recording=(tmp_path / "log.csv",)))


def test_a_recording_is_compared_and_not_judged(tmp_path: Path) -> None:
    """A recording that no car can have made still ends with 0."""
    time_s = np.arange(0.0, 6.0, 0.02)
    log, page, figures = tmp_path / "log.npz", tmp_path / "page.html", tmp_path / "figures.json"
    speed, angle = np.full_like(time_s, 20.0), 0.01 * np.sin(time_s)
    np.savez(log, time_s=time_s, v=speed, delta=angle, yaw_rate_radps=-10.0 * angle)
    columns = ("vx_mps=v", "road_wheel_rad=delta")
    options = RecordingOptions(recording=(log,), column=columns)
    assert validate(html=page, json_file=figures, recorded=options) == 0
    rate, yaw_rate = json.loads(figures.read_text("utf-8"))
    assert (rate["signal"], yaw_rate["signal"]) == ("speed_rate_mps2", "yaw_rate_radps")
    assert yaw_rate["recording"] == "log.npz"
    assert yaw_rate["error_percent"] > 100.0
    assert yaw_rate["gain"] < 0.0
    text = page.read_text("utf-8")
    assert 'class="plotly-graph-div"' in text
    assert "yaw_rate_radps" in text
