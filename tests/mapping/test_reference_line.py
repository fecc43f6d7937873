"""Poses are located relative to lines for which the result is known by hand."""

from pathlib import Path

import numpy as np
import pytest
from made_logs import write_csv

from offline.data.recording import Anchor, onto_road
from rt_controller.contract.errors import DatasetError
from rt_controller.mapping.reference_line import make_line, read_line
from rt_controller.mapping.tables import ColumnMapping, PoseMapping

RADIUS_M = 50.0
HERE = Path("line.csv")


def circle(points=400):
    angle = np.linspace(0.0, 2 * np.pi, points, endpoint=False)
    return RADIUS_M * np.stack([np.cos(angle), np.sin(angle)])


def pose_beside_circle(angle, ey_m, epsi_rad):
    radius = RADIUS_M - ey_m
    heading = angle + np.pi / 2
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), heading + epsi_rad], axis=1)


def test_poses_beside_a_circle_are_located_exactly():
    line = make_line(circle(), True, 0.0, HERE)
    assert line.length_m == pytest.approx(2 * np.pi * RADIUS_M, rel=1e-5)
    rng = np.random.default_rng(0)
    angle, ey = rng.uniform(0.0, 2 * np.pi, 200), rng.uniform(-8.0, 8.0, 200)
    epsi = rng.uniform(-0.5, 0.5, 200)
    at = line.locate(pose_beside_circle(angle, ey, epsi))
    np.testing.assert_allclose(at.s_m, RADIUS_M * angle, atol=2e-3)
    np.testing.assert_allclose(at.ey_m, ey, atol=1e-5)
    np.testing.assert_allclose(at.epsi_rad, epsi, atol=1e-5)
    np.testing.assert_allclose(at.curvature_per_m, 1.0 / RADIUS_M, rtol=1e-3)


def test_progress_continues_over_the_end_of_a_closed_line():
    line = make_line(circle(), True, 0.0, HERE)
    angle = np.radians([358.0, 359.0, 0.0, 1.0])
    at = line.locate(pose_beside_circle(angle, np.zeros(4), np.zeros(4)))
    assert line.progress(at.s_m) == pytest.approx(np.full(3, RADIUS_M * np.radians(1.0)), abs=2e-3)


def test_a_straight_line_has_no_curvature_and_left_is_positive():
    points = np.stack([np.arange(0.0, 100.0, 5.0), np.zeros(20)])
    at = make_line(points, False, 0.0, HERE).locate(np.array([[30.0, 2.0, 0.1 + 4 * np.pi]]))
    assert at.s_m == pytest.approx([30.0], abs=1e-6)
    assert at.ey_m == pytest.approx([2.0])
    assert at.epsi_rad == pytest.approx([0.1])
    assert at.curvature_per_m == pytest.approx([0.0], abs=1e-9)


def test_smoothing_removes_the_noise_of_the_points_from_the_curvature():
    noise = 0.03 * np.random.default_rng(0).normal(size=(2, 400))
    pose = pose_beside_circle(np.radians(np.arange(5.0, 355.0)), np.zeros(350), np.zeros(350))
    rough = make_line(circle() + noise, True, 0.0, HERE).locate(pose).curvature_per_m
    smooth = make_line(circle() + noise, True, 0.05, HERE).locate(pose).curvature_per_m
    assert np.max(np.abs(smooth - 1.0 / RADIUS_M)) < 0.2 / RADIUS_M
    assert np.max(np.abs(rough - 1.0 / RADIUS_M)) > 1.0 / RADIUS_M


def test_path_states_equal_those_of_a_placed_road():
    """A given circle, and the same circle placed under the first pose."""
    s = np.linspace(0.0, 60.0, 601)
    pose = np.stack([s, 1.0 + 0.5 * np.sin(0.1 * s), 0.05 * np.cos(0.1 * s)], axis=1)
    line = make_line(circle() + np.array([[0.0], [RADIUS_M]]), True, 0.0, HERE)
    at = line.locate(pose)
    anchor = Anchor(np.array([1.0 / RADIUS_M]), at.ey_m[:1], at.epsi_rad[:1])
    road = onto_road(pose[None], anchor)
    np.testing.assert_allclose(np.cumsum(line.progress(at.s_m)), road.s_m[0, 1:], atol=3e-3)
    np.testing.assert_allclose(at.ey_m, road.ey_m[0], atol=1e-4)
    np.testing.assert_allclose(at.epsi_rad, road.epsi_rad[0], atol=1e-4)


def settings(path):
    columns = {name: ColumnMapping(column=name, unit="m") for name in ("x", "y")}
    yaw = ColumnMapping(column="yaw", unit="rad")
    return PoseMapping(**columns, yaw=yaw, reference_line=path, closed=True)


def test_a_line_is_read_from_points_and_refused_with_what_is_wrong(tmp_path):
    x, y = circle()
    path = write_csv(tmp_path / "track.csv", {"x": x, "y": y})
    assert read_line(settings(path)).length_m == pytest.approx(2 * np.pi * RADIUS_M, rel=1e-3)
    for x, message in (
        ([0, 1, 1, 2], ": expected at least 8 different points"),
        ([0, 1, "", 1], ", line 4: expected x and y"),
    ):
        path = write_csv(tmp_path / "track.csv", {"x": x, "y": [0, 0, 0, 1]})
        with pytest.raises(DatasetError, match=rf"track\.csv{message}"):
            read_line(settings(path))
