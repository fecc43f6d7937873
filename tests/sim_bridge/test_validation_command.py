"""`sim-bridge validate` from end to end: the verdicts, the files, the exit code."""

import json
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import pytest

from rt_controller.contract.errors import ConfigError
from sim_bridge.validation.command import validate


@dataclass(frozen=True, slots=True)
class Outcome:
    exit_code: int
    lines: list[dict[str, Any]]
    html: str


def outcome(folder: Path, car: str | None) -> Outcome:
    page, figures = folder / "page.html", folder / "figures.json"
    code = validate(car=car, html=page, json_file=figures, quick=True)
    return Outcome(code, json.loads(figures.read_text("utf-8")), page.read_text("utf-8"))


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """The cars that the table names."""
    return outcome(tmp_path_factory.mktemp("table"), None)


@pytest.fixture(scope="module")
def spoiled(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """A car whose rear brakes are as strong as its front brakes, with no knee to hold them back."""
    folder = tmp_path_factory.mktemp("spoiled")
    file = resources.files("sim_bridge") / "cars" / "c_class_150kw_awd.toml"
    text = file.read_text("utf-8")
    changed = text.replace("rear_nm_per_mpa = { value = 150.0", "rear_nm_per_mpa = { value = 250.0")
    changed = changed.replace("slope_above_knee = { value = 0.3", "slope_above_knee = { value = 1")
    assert changed.count("250.0") == text.count("250.0") + 1
    car = folder / "strong_rear_brakes.toml"
    car.write_text(changed, "utf-8")
    return outcome(folder, str(car))


def test_every_line_of_the_table_holds(table: Outcome) -> None:
    assert [line["name"] for line in table.lines if line["ok"] is False] == []
    assert table.exit_code == 0


def test_all_seven_tests_are_in_the_table(table: Outcome) -> None:
    assert {line["test"] for line in table.lines} == {1, 2, 3, 4, 5, 6, 7}


def test_a_line_tells_what_was_aimed_at_and_what_was_reached(table: Outcome) -> None:
    for line in table.lines:
        assert {"test", "car", "name", "unit", "target", "reached", "tolerance", "ok"} <= set(line)
        assert isinstance(line["reached"], float)
        assert (line["target"] is None) == (line["tolerance"] is None)
        if line["ok"] is not None:
            above = line["low"] is None or line["reached"] >= line["low"]
            below = line["high"] is None or line["reached"] <= line["high"]
            assert line["ok"] is (above and below)


def test_both_directions_are_held_against_the_other_model(table: Outcome) -> None:
    turns = [line for line in table.lines if line["test"] == 4 and "on record" not in line["name"]]
    yaw_rates = [line["target"] for line in turns if line["name"].startswith("yaw rate")]
    assert len(yaw_rates) == 6
    assert sorted(target > 0.0 for target in yaw_rates) == [False] * 3 + [True] * 3


def test_the_sine_with_dwell_is_reported_and_not_judged(table: Outcome) -> None:
    dwell = [line for line in table.lines if line["test"] == 6]
    assert len(dwell) == 3
    assert all(line["ok"] is None and line["target"] is not None for line in dwell)


def test_the_page_holds_a_section_for_each_test_and_its_figures(table: Outcome) -> None:
    for test in range(1, 8):
        assert f"<section id='test-{test}'>" in table.html
    assert table.html.count('class="plotly-graph-div"') == 8
    text = table.html.replace("\\u002f", "/")
    for axis in ("steering wheel angle / deg", "yaw rate / (deg/s)", "frequency / Hz", "gear"):
        assert axis in text


def test_the_page_opens_without_a_network(table: Outcome) -> None:
    assert "<script src=" not in table.html
    assert "<link" not in table.html


def test_a_spoiled_car_fails_and_only_where_it_is_spoiled(spoiled: Outcome) -> None:
    """It is no car of the table: the targets are shown, the laws are held against it."""
    missed = [line["name"] for line in spoiled.lines if line["ok"] is False]
    assert missed == ["brakings in which a rear wheel locks first"]
    assert spoiled.exit_code == 1


def test_another_car_is_not_held_against_the_targets_of_the_table(spoiled: Outcome) -> None:
    by_name = {line["name"]: line for line in spoiled.lines}
    assert by_name["steering effort"]["target"] == 88.0
    assert by_name["steering effort"]["ok"] is None
    assert by_name["mirrored run differs by"]["ok"] is True
    assert 4 not in {line["test"] for line in spoiled.lines}


def test_an_unknown_car_is_refused_by_name() -> None:
    with pytest.raises(ConfigError, match="no_such_car"):
        validate(car="no_such_car")


def test_a_page_that_cannot_be_written_is_refused_before_the_drive(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="nowhere"):
        validate(html=tmp_path / "nowhere" / "page.html")
