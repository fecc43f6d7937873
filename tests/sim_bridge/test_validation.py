"""`sim-bridge validate`: the lines of its table, its files and its exit code."""

import json
import re
from importlib import resources
from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rt_controller.contract.errors import ConfigError, PlantError
from rt_controller.report.table import to_markdown
from sim_bridge.cli import validate
from sim_bridge.validation.acceptance import (
    TESTS,
    AcceptanceTest,
    Line,
    LineResult,
    acceptance_table,
    check_line,
    count_sentence,
)
from sim_bridge.validation.run import Run

NEAR = {"target": 8.5, "width": 0.5}
AT_MOST = {"target": 0.1, "bound": "at most"}
AT_LEAST = {"target": 6.0, "bound": "at least"}
GAP = AT_MOST | {"not_judged": "known gap"}


def result(reached: float, car: str = "this car", **line: Any) -> LineResult:
    one = Line(name="a line", unit="s", **line)
    test = AcceptanceTest(
        title="A test", manoeuvre="braking", cars=("this car",), kind="measured", text="",
        source="a book", lines=(one,),
    )  # fmt: skip
    return check_line(1, test, one, reached, car)


@pytest.mark.parametrize(
    ("goal", "passes", "fails"),
    [
        ({"target": 100.0, "share": 0.05}, (95.0, 100.0, 105.0), (94.9, 105.1)),
        ({"target": -0.6, "share": 0.1}, (-0.65, -0.55), (-0.67, -0.53, 0.6)),
        (NEAR, (8.0, 9.0), (7.99, 9.01)),
        (AT_MOST, (0.1, -3.0), (0.101,)),
        (AT_LEAST, (6.0, 7.0), (5.0,)),
    ],
)
def test_numbers_within_the_bounds_of_a_target_pass(
    goal: dict[str, Any], passes: tuple[float, ...], fails: tuple[float, ...]
) -> None:
    assert [result(reached, **goal).ok for reached in passes] == [True] * len(passes)
    assert [result(reached, **goal).ok for reached in fails] == [False] * len(fails)


@pytest.mark.parametrize(
    ("line", "reached", "car", "reason", "is_within"),
    [
        (NEAR, nan, "this car", "no such value in this drive", None),
        (AT_LEAST, inf, "this car", "no such value in this drive", None),
        (NEAR, 8.5, "another car", "target of another car", None),
        (GAP, 0.2, "this car", "known gap", False),
        (GAP, 0.1, "this car", "known gap", True),
        ({}, 3.0, "this car", None, None),
    ],
)
def test_a_line_that_is_not_judged_says_why(
    line: dict[str, Any], reached: float, car: str, reason: str | None, is_within: bool | None
) -> None:
    found = result(reached, car, **line)
    assert (found.ok, found.not_judged, found.is_within) == (None, reason, is_within)


def test_misses_stay_visible_in_the_table_and_in_the_count() -> None:
    gap = result(5.0, **NEAR, not_judged="known gap")
    lines = [gap, result(nan, **NEAR), result(8.5, **NEAR, fitted=True), result(5.0, **NEAR)]
    assert count_sentence(lines) == (
        "1 of 2 judged lines pass. 1 of 2 judged lines were not fitted; 0 of these pass. 2 lines "
        "are not judged; 1 of these are outside the range of their target"
    )
    text = to_markdown(acceptance_table(lines))
    for words in ("| outside |", "not judged: known gap", "| reported |", "MISSED", "| fitted |"):
        assert words in text
    assert "nan" not in text


@pytest.mark.nightly
def test_every_judged_line_has_a_source_passes_and_known_gaps_are_shown(tmp_path: Path) -> None:
    """Each test with the car that its targets belong to; half of the lines were not fitted."""
    figures = tmp_path / "figures.json"
    assert validate(json_file=figures) == 0
    lines = json.loads(figures.read_text("utf-8"))
    assert [line["name"] for line in lines if line["ok"] is False] == []
    gaps = {line["name"] for line in lines if line["is_within"] is False}
    assert {"load transfer, rear axle", "largest sideslip within 2 s, full pedal"} <= gaps
    judged = [line for line in lines if line["ok"] is not None]
    assert sum(line["fitted"] for line in judged) <= 0.5 * len(judged)
    for test in TESTS.values():
        assert all(line.target is None or line.source or test.source for line in test.lines)


@pytest.mark.nightly
def test_another_car_is_judged_only_by_the_targets_for_any_car(tmp_path: Path) -> None:
    """Rear brakes as strong as the front brakes, and no anti-lock."""
    text = (resources.files("sim_bridge") / "cars" / "c_class_150kw_awd.toml").read_text("utf-8")
    changed = text.replace("rear_nm_per_mpa = { value = 150.0", "rear_nm_per_mpa = { value = 250.0")
    changed = changed.replace("slope_above_knee = { value = 0.3", "slope_above_knee = { value = 1")
    changed = re.sub(r"(\[anti_lock\]\nslip = \{ value = )[0-9.]+", r"\g<1>0.0", changed)
    car, figures = tmp_path / "strong_rear_brakes.toml", tmp_path / "figures.json"
    car.write_text(changed, "utf-8")
    assert validate(car=str(car), json_file=figures) == 1
    lines = {line["name"]: line for line in json.loads(figures.read_text("utf-8"))}
    assert lines["brakings in which a rear wheel locks first"]["ok"] is False
    effort = lines["steering effort"]
    assert (effort["target"], effort["ok"]) == (88.0, None)
    assert effort["not_judged"] == "target of another car"
    assert lines["creep in 10 s with the brake on a grade of 20 %"]["ok"] is True


@pytest.mark.parametrize(
    ("options", "named"),
    [({"car": "no_such_car"}, "no_such_car"), ({"json_file": Path("no/x.json")}, "no/x")],
)
def test_an_option_that_cannot_be_used_is_refused_by_name(
    options: dict[str, Any], named: str
) -> None:
    with pytest.raises(ConfigError, match=named):
        validate(**options)


def test_a_car_that_fails_is_refused_with_the_time() -> None:
    motion = np.full((5, 3), 20.0)
    motion[3:] = np.nan
    with pytest.raises(PlantError, match=r"0\.30 s"):
        Run(0.1, np.zeros((5, 3)), motion, np.zeros((5, 3)), np.zeros((5, 28)))
