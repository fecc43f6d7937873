"""The line of a road given by points, and where a car is along and beside it.

A smoothing spline follows the points, so that its curvature is that of the road and not of the
noise of the points; poses are projected onto the spline.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import splev, splprep
from scipy.spatial import cKDTree

from offline.logs.mapping_tables import CsvSettings, PoseMapping, TimeMapping
from offline.logs.readers.csv_log import read_csv
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import DatasetError

LEAST_POINTS = 8
DEGREE = 5
"""of the spline: its curvature has three continuous derivatives"""
NODE_SPACING_M = 0.25
_NEWTON_STEPS = 3


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
        for _ in range(_NEWTON_STEPS):
            away = self._at(u, 0) - point
            tangent, bend = self._at(u, 1), self._at(u, 2)
            curve = np.sum(tangent * tangent + away * bend, axis=0)
            # Beyond the centre of curvature Newton diverges; there the nearest node is kept.
            step = np.sum(away * tangent, axis=0) / np.abs(curve + 1e-30)
            u = u - np.where(curve > 0.0, step, 0.0)
            u = low + np.mod(u - low, high - low) if self.is_closed else np.clip(u, low, high)
        tangent, bend = self._at(u, 1), self._at(u, 2)
        speed = np.hypot(*tangent)
        dx, dy = point - self._at(u, 0)
        heading = np.arctan2(tangent[1] / speed, tangent[0] / speed)
        return LinePose(
            s_m=np.interp(u, self.parameter, self.s_m),
            ey_m=tangent[0] / speed * dy - tangent[1] / speed * dx,
            epsi_rad=np.remainder(pose[:, 2] - heading + np.pi, 2.0 * np.pi) - np.pi,
            curvature_per_m=(tangent[0] * bend[1] - tangent[1] * bend[0]) / speed**3,
        )

    def progress(self, s_m: Array) -> Array:
        """Distance driven (T-1,) between neighbouring stations (T,)."""
        way = np.diff(s_m)
        if not self.is_closed:
            return way
        return np.remainder(way + 0.5 * self.length_m, self.length_m) - 0.5 * self.length_m

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
    log = read_csv(path, ("x", "y"), TimeMapping(period_s=1.0), CsvSettings())
    points = np.stack([channel.values for channel in log.channels])
    missing = np.flatnonzero(~np.isfinite(points).all(axis=0))
    if len(missing):
        raise DatasetError(
            f"{path}, line {log.channels[0].row[missing[0]]}: expected x and y in m, found no "
            f"number. Correct or leave out that point."
        )
    return make_line(points, settings.closed, settings.smoothing_m, path)


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
    spline, _ = splprep(
        points, u=chord_m, s=points.shape[1] * smoothing_m**2, per=int(is_closed), k=DEGREE
    )
    count = max(int(chord_m[-1] / NODE_SPACING_M), 2 * LEAST_POINTS)
    parameter = np.linspace(0.0, chord_m[-1], count + 1)
    nodes = np.asarray(splev(parameter, spline))
    return ReferenceLine(spline, parameter, _arc_length(nodes), cKDTree(nodes.T), is_closed)


def _arc_length(points: Array) -> Array:
    """Distance (N,) along the polygon through the points (2, N)."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points)))])
