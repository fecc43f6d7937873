"""Cones, lanes and bodies: hits and margins against plain geometry."""

import numpy as np
import pytest

from sim_bridge.scenario.courses import (
    CONE_RADIUS_M,
    Body,
    Cone,
    Course,
    IsoLaneChange,
    Lane,
    Poses,
    Slalom,
    cone_hits,
    lane_margin_m,
    road_margin_m,
)
from sim_bridge.scenario.lateral import Lateral
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
    course = Course(BODY, (Cone(30.0, inner * (beside_m + gap_m)),))
    assert cone_hits(course, drive_past(0.0, curvature)) == hits


def test_a_cone_between_two_periods_is_not_missed() -> None:
    course = Course(BODY, (Cone(30.25, 0.0),))
    fast = Poses(*(part[::8] for part in drive_past(0.0)))
    assert cone_hits(course, fast) == 1


def test_the_margin_to_a_lane_is_that_of_the_nearest_corner() -> None:
    course = Course(BODY, lanes=(Lane(20.0, 40.0, -1.5, 1.2),))
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
