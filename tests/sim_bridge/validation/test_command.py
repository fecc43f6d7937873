"""`sim-bridge validate` from end to end: results, files, exit code."""

import json
import re
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import pytest

from rt_controller.contract.errors import ConfigError
from sim_bridge.validation.acceptance import TESTS
from sim_bridge.validation.command import validate


@dataclass(frozen=True, slots=True)
class ValidationRun:
    exit_code: int
    lines: list[dict[str, Any]]
    html: str


def run_validation(folder: Path, car: str | None) -> ValidationRun:
    page, figures = folder / "page.html", folder / "figures.json"
    code = validate(car=car, html=page, json_file=figures)
    return ValidationRun(code, json.loads(figures.read_text("utf-8")), page.read_text("utf-8"))


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> ValidationRun:
    """Each test with the car that its targets belong to."""
    return run_validation(tmp_path_factory.mktemp("table"), None)


@pytest.fixture(scope="module")
def strong_rear(tmp_path_factory: pytest.TempPathFactory) -> ValidationRun:
    """A car without anti-lock, whose rear brakes are as strong as its front brakes."""
    folder = tmp_path_factory.mktemp("strong_rear")
    file = resources.files("sim_bridge") / "cars" / "c_class_150kw_awd.toml"
    text = file.read_text("utf-8")
    changed = text.replace("rear_nm_per_mpa = { value = 150.0", "rear_nm_per_mpa = { value = 250.0")
    changed = changed.replace("slope_above_knee = { value = 0.3", "slope_above_knee = { value = 1")
    changed = re.sub(r"(\[anti_lock\]\nslip = \{ value = )[0-9.]+", r"\g<1>0.0", changed)
    car = folder / "strong_rear_brakes.toml"
    car.write_text(changed, "utf-8")
    return run_validation(folder, str(car))


def test_every_judged_line_passes_and_known_gaps_are_shown(table: ValidationRun) -> None:
    assert [line["name"] for line in table.lines if line["ok"] is False] == []
    assert table.exit_code == 0
    gaps = {line["name"] for line in table.lines if line["is_within"] is False}
    assert {"load transfer, rear axle", "largest sideslip within 2 s, full pedal"} <= gaps


def test_at_least_half_of_the_judged_lines_were_not_fitted(table: ValidationRun) -> None:
    judged = [line for line in table.lines if line["ok"] is not None]
    assert sum(line["fitted"] for line in judged) <= 0.5 * len(judged)


def test_the_page_has_a_section_for_each_test_its_figures_and_no_links(
    table: ValidationRun,
) -> None:
    for test in TESTS:
        assert f"<h2>{test} · " in table.html
    assert table.html.count("<svg") == 6
    for axis in ("steering wheel / deg", "yaw rate / (deg/s)", "sideslip / deg"):
        assert axis in table.html
    assert "<script src=" not in table.html
    assert "<link" not in table.html


def test_another_car_is_judged_only_by_the_targets_for_any_car(strong_rear: ValidationRun) -> None:
    """Rear brakes as strong as the front brakes, and no anti-lock."""
    missed = [line["name"] for line in strong_rear.lines if line["ok"] is False]
    assert "brakings in which a rear wheel locks first" in missed
    assert strong_rear.exit_code == 1
    by_name = {line["name"]: line for line in strong_rear.lines}
    effort = by_name["steering effort"]
    assert (effort["target"], effort["ok"]) == (88.0, None)
    assert effort["not_judged"] == "target of another car"
    assert by_name["creep in 10 s with the brake on a grade of 20 %"]["ok"] is True


@pytest.mark.parametrize(
    ("options", "named"),
    [({"car": "no_such_car"}, "no_such_car"), ({"html": Path("nowhere/page.html")}, "nowhere")],
)
def test_an_option_that_cannot_be_used_is_refused_by_name(
    options: dict[str, Any], named: str
) -> None:
    with pytest.raises(ConfigError, match=named):
        validate(**options)
