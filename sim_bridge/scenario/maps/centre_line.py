"""`CentreLine`: a smooth line through points of a map, with its curvature over arc length."""

from dataclasses import dataclass
from math import pi

import numpy as np

from rt_controller.contract.arrays import Array
from sim_bridge.scenario.limits import LONGEST_ROAD_M
from sim_bridge.scenario.table import Table, through

SHORTEST_WAVE_M = 15.0
"""waves of the points that are shorter are noise of the map"""
SAMPLE_M = 1.0
LEAST_DISTANCE_M = 0.1
"""points that are closer to each other are one"""
LEAST_LENGTH_M = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class CentreLine:
    """A line in the plane."""

    points: Array
    """(n, 2), equally spaced"""
    yaw_rad: Array
    """(n,) direction at the points"""
    s_m: Array
    """(n,) arc length of the points"""
    curvature_per_m: Table

    @property
    def length_m(self) -> float:
        """The arc length of the whole line."""
        return float(self.s_m[-1])

    def place(self, point: Array, yaw_rad: float) -> tuple[float, float, float]:
        """(arc length, lateral deviation, heading error) of a pose in the plane.

        Of a line that passes a place several times, the first pass counts.
        """
        offset = point - self.points
        distance_m = np.hypot(*offset.T)
        close = np.flatnonzero(distance_m < distance_m.min() + SAMPLE_M)
        first_pass = close[: 1 + int(np.argmax(np.diff(close, append=2 * len(offset)) > 1))]
        near = int(first_pass[np.argmin(distance_m[first_pass])])
        c, s = np.cos(self.yaw_rad[near]), np.sin(self.yaw_rad[near])
        x, y = offset[near]
        along, left = x * c + y * s, y * c - x * s
        turn = (yaw_rad - float(self.yaw_rad[near]) + pi) % (2.0 * pi) - pi
        s_m = min(max(float(self.s_m[near] + along), 0.0), self.length_m)
        return s_m, float(left), turn


def through_points(points: Array) -> CentreLine:
    """A smooth line along points (n, 2) in driving order.

    A cubic spline through the points is sampled and smoothed: of what is shorter than
    `SHORTEST_WAVE_M`, less than half is left. Bends of constant curvature are not changed.

    Raises:
        ValueError: the line is too short or too long.
    """
    from scipy.interpolate import CubicSpline, make_smoothing_spline

    kept = _apart(points)
    chord_m = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(kept, axis=0).T))))
    if not LEAST_LENGTH_M <= chord_m[-1] <= LONGEST_ROAD_M:
        raise ValueError(
            f"expected a centre line of {LEAST_LENGTH_M:g}..{LONGEST_ROAD_M:g} m, found "
            f"{chord_m[-1]:.3g} m"
        )
    count = max(8, round(chord_m[-1] / SAMPLE_M) + 1)
    at_m = np.linspace(0.0, chord_m[-1], count)
    dense = CubicSpline(chord_m, kept)(at_m) if len(kept) > 2 else _between(chord_m, kept, at_m)
    weight = (SHORTEST_WAVE_M / (2.0 * pi)) ** 4 / SAMPLE_M
    spline_x, spline_y = (make_smoothing_spline(at_m, column, lam=weight) for column in dense.T)
    fine = np.linspace(0.0, chord_m[-1], 4 * count)
    s_m = np.concatenate(
        ([0.0], np.cumsum(np.hypot(np.diff(spline_x(fine)), np.diff(spline_y(fine)))))
    )
    even_m = np.linspace(0.0, s_m[-1], count)
    u = np.interp(even_m, s_m, fine)
    dx, dy = spline_x(u, 1), spline_y(u, 1)
    curvature = (dx * spline_y(u, 2) - dy * spline_x(u, 2)) / np.hypot(dx, dy) ** 3
    return CentreLine(
        points=np.column_stack((spline_x(u), spline_y(u))),
        yaw_rad=np.arctan2(dy, dx),
        s_m=even_m,
        curvature_per_m=through(even_m.tolist(), curvature.tolist()),
    )


def _apart(points: Array) -> Array:
    """The points that are not too close to the one before."""
    kept = [points[0]]
    for point in points[1:]:
        if np.hypot(*(point - kept[-1])) > LEAST_DISTANCE_M:
            kept.append(point)
    return np.array(kept)


def _between(chord_m: Array, points: Array, at_m: Array) -> Array:
    """Points on the straight between two."""
    return np.column_stack([np.interp(at_m, chord_m, column) for column in points.T])
