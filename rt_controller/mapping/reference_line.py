"""The line of a road given by points, and where a car is along and beside it.

A smoothing spline follows the points, so that its curvature is that of the road and not of the
noise of the points; poses are projected onto the spline.
"""

import csv
from dataclasses import dataclass
from math import isfinite, nan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import splev, splprep
from scipy.spatial import cKDTree

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.files import read_text
from rt_controller.mapping.tables import PoseMapping

LEAST_POINTS, NODE_SPACING_M, NEWTON_STEPS = 8, 0.25, 3


class LinePose(NamedTuple):
    """Where a car is relative to the line, and the curvature of the line there, (T,) each."""

    s_m: Array
    ey_m: Array
    """left is positive"""
    epsi_rad: Array
    """in ±pi"""
    curvature_per_m: Array


@dataclass(frozen=True, slots=True)
class ReferenceLine:
    """A smooth line on a plane."""

    spline: Any
    """knots, coefficients and degree, as scipy's splev takes them"""
    parameter: Array
    """(M,) of the spline at the nodes"""
    s_m: Array
    """(M,) arc length at the nodes"""
    tree: Any
    """of the nodes' positions"""
    is_closed: bool

    @property
    def length_m(self) -> float:
        """Arc length of the whole line."""
        return float(self.s_m[-1])

    def locate(self, pose: Array) -> LinePose:
        """The poses (T, 3), columns X_m, Y_m and yaw_rad, relative to the line."""
        point = pose[:, :2].T
        _, nearest = self.tree.query(pose[:, :2])
        u = self.parameter[nearest]
        low, high = self.parameter[0], self.parameter[-1]
        for _ in range(NEWTON_STEPS):
            away = self._at(u, 0) - point
            tangent, bend = self._at(u, 1), self._at(u, 2)
            curve = np.sum(tangent * tangent + away * bend, axis=0)
            # Beyond the centre of curvature Newton diverges; there the nearest node is kept.
            step = np.sum(away * tangent, axis=0) / np.abs(curve + 1e-30)
            u = u - np.where(curve > 0.0, step, 0.0)
            u = low + np.mod(u - low, high - low) if self.is_closed else np.clip(u, low, high)
        (tx, ty), (dx, dy) = self._at(u, 1), point - self._at(u, 0)
        speed = np.hypot(tx, ty)
        heading = np.arctan2(ty / speed, tx / speed)
        return LinePose(
            s_m=np.interp(u, self.parameter, self.s_m),
            ey_m=tx / speed * dy - ty / speed * dx,
            epsi_rad=np.remainder(pose[:, 2] - heading + np.pi, 2.0 * np.pi) - np.pi,
            curvature_per_m=self._curvature(u),
        )

    def place(self, s_m: float, ey_m: float, epsi_rad: float) -> tuple[float, float, float]:
        """x, y and yaw of a car at one place of the line: the inverse of `locate`."""
        along_m = s_m % self.length_m if self.is_closed else s_m
        u = np.interp(along_m, self.s_m, self.parameter)
        (x, y), (dx, dy) = self._at(np.asarray(u), 0), self._at(np.asarray(u), 1)
        heading = float(np.arctan2(dy, dx))
        beyond_m = 0.0 if self.is_closed else along_m - min(max(along_m, 0.0), self.length_m)
        return (
            float(x + beyond_m * np.cos(heading) - ey_m * np.sin(heading)),
            float(y + beyond_m * np.sin(heading) + ey_m * np.cos(heading)),
            heading + epsi_rad,
        )

    def curvature_ahead(self, s_m: float, reach_m: float, count: int) -> Array:
        """Curvature (count,) at equal distances from `s_m` to `reach_m` ahead of it."""
        along_m = s_m + np.linspace(0.0, reach_m, count)
        if self.is_closed:
            along_m = np.mod(along_m, self.length_m)
        return self._curvature(np.interp(along_m, self.s_m, self.parameter))

    def progress(self, s_m: Array) -> Array:
        """Distance driven (T-1,) between neighbouring stations (T,)."""
        way = np.diff(s_m)
        if not self.is_closed:
            return way
        return np.remainder(way + 0.5 * self.length_m, self.length_m) - 0.5 * self.length_m

    def _curvature(self, u: Array) -> Array:
        (tx, ty), (bx, by) = self._at(u, 1), self._at(u, 2)
        return np.asarray((tx * by - ty * bx) / np.hypot(tx, ty) ** 3)

    def _at(self, u: Array, derivative: int) -> Array:
        return np.asarray(splev(u, self.spline, der=derivative))


def read_line(settings: PoseMapping) -> ReferenceLine | None:
    """The reference line of the mapping; None if it has none.

    Raises:
        DatasetError: the file cannot be read, or has too few points.
    """
    path = settings.reference_line
    if path is None:
        return None
    return make_line(_read_points(path), settings.closed, settings.smoothing_m, path)


def _read_points(path: Path) -> Array:
    """Points (2, N) of the columns x and y of a CSV file; the delimiter is detected."""
    try:
        lines = read_text(path).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise DatasetError(
            f"{path}: expected a CSV of x and y in m along a road, found nothing readable "
            f"({error}). Correct `reference_line` in [pose]."
        ) from error
    head = lines[0] if lines else ""
    delimiter = next((mark for mark in (";", "\t", ",") if mark in head), ",")
    rows = csv.DictReader(lines, delimiter=delimiter, skipinitialspace=True)
    if not {"x", "y"} <= set(rows.fieldnames or ()):
        raise DatasetError(
            f"{path}: expected the columns x and y in its first line, found {head!r}. Name the "
            f"columns of the reference line so."
        )
    points = []
    for row in rows:
        texts = [str(row[name]) for name in ("x", "y")]
        if delimiter != ",":
            texts = [text.replace(",", ".") for text in texts]
        try:
            point = [float(text) for text in texts]
        except ValueError:
            point = [nan]
        if not all(map(isfinite, point)):
            raise DatasetError(
                f"{path}, line {rows.line_num}: expected x and y in m, found no number. Correct or "
                f"leave out that point."
            )
        points.append(point)
    return np.array(points, dtype=np.float64).reshape(-1, 2).T


def make_line(points: Array, is_closed: bool, smoothing_m: float, path: Path) -> ReferenceLine:
    """The smooth line near points (2, N) in m, in their order; `DatasetError` if too few."""
    if is_closed:
        points = np.concatenate([points, points[:, :1]], axis=1)
    is_new = np.concatenate([[True], np.hypot(*np.diff(points)) > 0.0])
    points = points[:, is_new]
    if points.shape[1] < LEAST_POINTS:
        raise DatasetError(
            f"{path}: expected at least {LEAST_POINTS} different points along a road, found "
            f"{points.shape[1]}. Give a reference line of the whole road."
        )
    chord_m = _arc_length(points)
    if is_closed:
        points[:, -1] = points[:, 0]
    smoothing = points.shape[1] * smoothing_m**2
    # Of degree 5: its curvature has three continuous derivatives.
    spline, _ = splprep(points, u=chord_m, s=smoothing, per=int(is_closed), k=5)
    count = max(int(chord_m[-1] / NODE_SPACING_M), 2 * LEAST_POINTS)
    parameter = np.linspace(0.0, chord_m[-1], count + 1)
    nodes = np.asarray(splev(parameter, spline))
    return ReferenceLine(spline, parameter, _arc_length(nodes), cKDTree(nodes.T), is_closed)


def _arc_length(points: Array) -> Array:
    """Distance (N,) along the polygon through the points (2, N)."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points)))])
