"""Cones, lanes and bodies against plain geometry; figures of a drive; the shipped scenarios."""

import re
import tomllib
from math import inf, isnan
from pathlib import Path

import numpy as np
import pytest

from rt_controller.drive.scenario import ConeAt, LaneAt
from sim_bridge.scenario import Scenario, load_scenario, parse_scenario, shipped_scenarios
from sim_bridge.scenario.courses import (
    CONE_RADIUS_M,
    Body,
    Course,
    IsoLaneChange,
    Poses,
    Slalom,
    cone_hits,
    lane_margin_m,
    road_margin_m,
)
from sim_bridge.scenario.lateral import Lateral
from sim_bridge.scenario.metrics import LogRow, Metrics, judged, measure
from sim_bridge.scenario.nominal_drive import drive_nominally
from sim_bridge.scenario.speed import Stop
from sim_bridge.scenario.table import through

BODY = Body(width_m=1.8, front_m=2.0, rear_m=2.5)


def drive_past(ey_m: float, curvature: float = 0.0, epsi_rad: float = 0.0) -> Poses:
    s_m = np.arange(0.0, 60.0, 0.5)
    same = np.ones_like(s_m)
    return Poses(s_m, ey_m * same, epsi_rad * same, curvature * same)


def iso(part: int, start_m: float, body: Body = BODY) -> tuple[Course, Lateral]:
    fields = {"kind": f"iso_3888_{part}", "start_s_m": start_m, "clearance_m": 0.1}
    return IsoLaneChange.model_validate(fields).driven_by(body)


def along(course: tuple[Course, Lateral]) -> Poses:
    s_m = np.arange(0.0, 400.0, 0.2)
    ey_m = course[1].ey_m(s_m, s_m)
    return Poses(s_m, ey_m, np.arctan(np.gradient(ey_m, s_m)), 0.0 * s_m)


@pytest.mark.parametrize("curvature", [0.0, 0.02, -0.02])
@pytest.mark.parametrize(("gap_m", "hits"), [(0.01, 0), (-0.01, 1)])
def test_a_cone_is_hit_if_its_base_overlaps_the_body(
    curvature: float, gap_m: float, hits: int
) -> None:
    beside_m = 0.5 * BODY.width_m + CONE_RADIUS_M
    # On a bend the front and rear of the body are farther out than its middle.
    inner = 1.0 if curvature >= 0.0 else -1.0
    course = Course(BODY, (ConeAt(30.0, inner * (beside_m + gap_m)),))
    assert cone_hits(course, drive_past(0.0, curvature)) == hits


def test_the_margin_to_a_lane_is_that_of_the_nearest_corner() -> None:
    course = Course(BODY, lanes=(LaneAt(20.0, 40.0, -1.5, 1.2),))
    assert lane_margin_m(course, drive_past(0.0)) == pytest.approx(0.3)
    turned = lane_margin_m(course, drive_past(0.0, epsi_rad=0.1))
    assert turned == pytest.approx(1.2 - 0.9 * np.cos(0.1) - 2.0 * np.sin(0.1), abs=1e-6)
    assert lane_margin_m(course, drive_past(1.0)) == pytest.approx(-0.7)


def test_the_margin_to_the_road_follows_its_width() -> None:
    width_m = through((0.0, 60.0), (4.0, 3.0))
    assert road_margin_m(BODY, drive_past(0.2), width_m) == pytest.approx(1.5 - 1.1, abs=0.02)
    assert road_margin_m(BODY, drive_past(1.0), width_m) < 0.0


@pytest.mark.parametrize(
    ("part", "start_m", "lengths", "widths"),
    [
        (1, [40.0, 85.0, 135.0, 150.0], [15.0, 25.0, 15.0, 15.0], [2.23, 2.41, 2.59, 2.59]),
        (2, [40.0, 65.5, 89.0], [12.0, 11.0, 12.0], [2.23, 2.80, 3.0]),
    ],
)
def test_the_sections_of_iso_3888_have_their_lengths_and_widths(
    part: int, start_m: list[float], lengths: list[float], widths: list[float]
) -> None:
    first, second, *_ = lanes = iso(part, 40.0)[0].lanes
    assert [lane.start_m for lane in lanes] == pytest.approx(start_m)
    assert [lane.end_m - lane.start_m for lane in lanes] == pytest.approx(lengths)
    assert [lane.left_m - lane.right_m for lane in lanes] == pytest.approx(widths)
    if part == 1:
        assert second.right_m - first.right_m == pytest.approx(3.5)
    else:
        assert second.right_m - first.left_m == pytest.approx(1.0)


@pytest.mark.parametrize("part", [1, 2])
@pytest.mark.parametrize("width_m", [1.6, 2.1])
def test_the_path_through_an_iso_course_hits_no_cone(part: int, width_m: float) -> None:
    course = iso(part, 40.0, BODY.model_copy(update={"width_m": width_m}))
    assert cone_hits(course[0], along(course)) == 0
    assert lane_margin_m(course[0], along(course)) > 0.02


def test_the_path_of_a_slalom_passes_its_cones_in_turn_with_its_clearance() -> None:
    course = Slalom(kind="slalom", start_s_m=10.0, spacing_m=36.0, cones=5).driven_by(BODY)
    sides = [float(course[1].ey_m(np.array([c.s_m]), np.zeros(1))[0])
             for c in course[0].cones]  # fmt: skip
    assert np.sign(sides).tolist() == [1.0, -1.0, 1.0, -1.0, 1.0]
    assert np.abs(sides) == pytest.approx(0.9 + CONE_RADIUS_M + 0.3, abs=1e-6)
    assert cone_hits(course[0], along(course)) == 0


ROW = LogRow(0.0, 0.0, 0.0, 0.0, 0.0, 20.0, 0.0, 0.0, 0.0, 0.0, 0.0, 20.0, -1)


def test_errors_are_measured_against_the_reference() -> None:
    first = ROW._replace(ey_m=1.0, wanted_ey_m=0.9, vx_mps=19.0)
    last = ROW._replace(ey_m=-0.3, epsi_rad=0.02, wanted_epsi_rad=0.01, yaw_rate_radps=0.2)
    log = [first, last]
    metrics = measure(log, (), Course())
    assert metrics.ey_peak_m == pytest.approx(0.3)
    assert metrics.ey_rms_m == pytest.approx(np.sqrt((0.01 + 0.09) / 2))
    assert metrics.epsi_peak_rad == pytest.approx(0.01)
    assert metrics.speed_peak_mps == pytest.approx(1.0)
    assert metrics.lateral_peak_mps2 == pytest.approx(4.0)
    assert isnan(metrics.cone_hits)
    assert isnan(metrics.stop_error_m)


def test_a_hold_is_judged_by_its_place_and_its_movement() -> None:
    held = ROW._replace(stop=0.0, s_m=100.2, vx_mps=0.0)
    log = [ROW, held, held._replace(s_m=100.23, steer_rad=0.01), held, ROW]
    metrics = measure(log, (Stop(at_s_m=100.0, hold_s=1.0),), Course())
    assert metrics.stop_error_m == pytest.approx(0.2)
    assert metrics.creep_m == pytest.approx(0.03)
    assert metrics.hold_steer_rad == pytest.approx(0.01)
    assert metrics.stops_missed == 0.0


def test_a_stop_that_was_not_reached_is_missed() -> None:
    metrics = measure([ROW, ROW], (Stop(at_s_m=100.0),), Course())
    assert metrics.stop_error_m == inf
    assert metrics.stops_missed == 1.0
    assert isnan(metrics.creep_m)


def test_figures_are_judged_by_their_limits() -> None:
    metrics = Metrics(ey_peak_m=0.3, lane_margin_m=0.1, cone_hits=2.0)
    limits = {"ey_peak_m": 0.2, "lane_margin_m": 0.05, "creep_m": 1.0}
    figures = judged(metrics, ("cone_hits",), limits)
    assert [(figure.name, figure.is_kept) for figure in figures] == [
        ("ey_peak_m", False),
        ("creep_m", False),
        ("cone_hits", True),
        ("lane_margin_m", True),
    ]
    assert figures[0].text == "0.3 (limit 0.2, MISSED)"


def peak_lateral_mps2(scenario: Scenario) -> float:
    """The largest lateral acceleration of the drive if it follows the reference exactly."""
    drive = drive_nominally(scenario)
    return float(np.max(np.abs(drive.turn_per_m) * drive.speed_mps**2))


@pytest.mark.parametrize("name", shipped_scenarios())
def test_every_shipped_scenario_stays_within_the_grip_of_its_road(name: str) -> None:
    scenario = load_scenario(name)
    friction = min(scenario.road.friction_left.lowest().value, 0.85)
    assert peak_lateral_mps2(scenario) < 0.8 * 9.81 * friction


DOCS = Path(__file__).parents[2] / "docs"
GUIDE = "".join(
    (DOCS / page).read_text(encoding="utf-8")
    for page in ("scenarios.md", "reference/scenario-fields.md")
)
EXAMPLES = [
    block
    for block in re.findall(r"```toml\n(.*?)```", GUIDE, re.DOTALL)
    if "without test" not in block
]


def test_the_guide_has_every_figure_and_its_examples_load() -> None:
    for text in EXAMPLES:
        assert parse_scenario(tomllib.loads(text), "guide").ticks > 0
    for name in (*Metrics._fields, *shipped_scenarios()):
        assert f"`{name}`" in GUIDE, name
