"""A drive in the plane: its road, path, car and predictions, seen from above.

x and y are in metres; the origin is the road's reference line at the first place of the drive,
x along its tangent there, y to the left.
"""

from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.drive.scenario import Outline, RoadLine
from rt_controller.drive.table import Drive

STEP_M = 0.5
"""between two places of a road that the drive itself has to show"""
AHEAD_M = 10.0
"""of a road that ends with the drive: the car stands on it"""
HALF_LANE_M = 1.75
"""of a nominal lane around the path"""


class Line(NamedTuple):
    """Points in the plane; NaN: a gap."""

    x_m: Array
    y_m: Array


class Poses(NamedTuple):
    """A body in the plane, of each tick."""

    x_m: Array
    y_m: Array
    yaw_rad: Array


class PlaneRoad(NamedTuple):
    """The reference line of a road in the plane."""

    s_m: Array
    """(n,), increasing"""
    x_m: Array
    y_m: Array
    heading_rad: Array

    def at(self, s_m: Array, ey_m: Array | float) -> Line:
        """The places at these arc lengths, `ey_m` to the left of the reference line."""
        x_m, y_m = (np.interp(s_m, self.s_m, each) for each in (self.x_m, self.y_m))
        heading_rad = np.interp(s_m, self.s_m, self.heading_rad)
        return Line(x_m - ey_m * np.sin(heading_rad), y_m + ey_m * np.cos(heading_rad))

    def poses(self, s_m: Array, ey_m: Array, epsi_rad: Array) -> Poses:
        """The same of a body, whose heading is `epsi_rad` relative to the road."""
        yaw_rad = np.interp(s_m, self.s_m, self.heading_rad) + epsi_rad
        return Poses(*self.at(s_m, ey_m), yaw_rad)


class PlanView(NamedTuple):
    """A drive in the plane."""

    road: PlaneRoad
    centre: Line
    """the reference line"""
    edges: tuple[Line, ...]
    """of the lanes or of the road of the scenario"""
    nominal: tuple[Line, ...]
    """edges of a lane around the path, where the scenario has none"""
    path: Line
    """of each tick, beside the car"""
    cones: Line
    car: Poses
    """of each tick: of a simulated car its true pose"""
    horizons: dict[int, Line]
    """predicted positions, from now on, of the ticks whose plan was recorded"""


def plan_view(drive: Drive) -> PlanView:
    """The drive in the plane.

    Without a scenario the road is the one whose curvature was received.
    """
    s_m, ey_m, epsi_rad = drive.poses.T
    line = _driven_line(drive, s_m)
    if drive.scenario is not None and drive.scenario.road is not None:
        line = drive.scenario.road
    road = _place_road(line, s_m[0] if len(s_m) else 0.0)
    path = road.at(s_m, drive["path_ey_m"])
    edges, cones = list[Line](), Line(np.empty(0), np.empty(0))
    if drive.scenario is not None:
        for lane in drive.scenario.lanes:
            along_m = np.append(np.arange(lane.start_m, lane.end_m, STEP_M), lane.end_m)
            edges += (road.at(along_m, side_m) for side_m in (lane.right_m, lane.left_m))
        if drive.scenario.cones:
            cones = road.at(*np.array(drive.scenario.cones).T)
    if not edges and np.isfinite(line.half_width_m).any():
        edges += (road.at(line.s_m, side * line.half_width_m) for side in (-1.0, 1.0))
    nominal = list[Line]()
    if not edges:
        sides_m = (drive["path_ey_m"] + side * HALF_LANE_M for side in (-1.0, 1.0))
        nominal += (road.at(s_m, side_m) for side_m in sides_m)
    return PlanView(
        road,
        Line(road.x_m, road.y_m),
        tuple(edges),
        tuple(nominal),
        path,
        cones,
        road.poses(s_m, ey_m, epsi_rad),
        {each.tick: road.at(each.s_m, each.ey_m) for each in drive.horizons},
    )


def corners(car: Poses, tick: int, body: Outline) -> Line:
    """The four corners of the car in this tick."""
    along_m = np.array([body.front_m, -body.rear_m, -body.rear_m, body.front_m])
    left_m = 0.5 * body.width_m * np.array([1.0, 1.0, -1.0, -1.0])
    x_m, y_m, yaw_rad = (float(each[tick]) for each in car)
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return Line(x_m + cos * along_m - sin * left_m, y_m + sin * along_m + cos * left_m)


def _place_road(line: RoadLine, start_m: float) -> PlaneRoad:
    """The line in the plane: the heading is the integral of the curvature over arc length."""
    step_m, curvature = np.diff(line.s_m), line.curvature_per_m
    turned = np.cumsum(0.5 * step_m * (curvature[:-1] + curvature[1:]))
    heading_rad = np.concatenate(([0.0], turned))
    heading_rad -= np.interp(start_m, line.s_m, heading_rad)
    middle_rad = 0.5 * (heading_rad[:-1] + heading_rad[1:])
    x_m, y_m = (
        np.concatenate(([0.0], np.cumsum(step_m * along)))
        for along in (np.cos(middle_rad), np.sin(middle_rad))
    )
    x_m -= np.interp(start_m, line.s_m, x_m)
    y_m -= np.interp(start_m, line.s_m, y_m)
    return PlaneRoad(line.s_m, x_m, y_m, heading_rad)


def _driven_line(drive: Drive, s_m: Array) -> RoadLine:
    """The road as far as it was received, and straight on."""
    places_m, first = np.unique(s_m, return_index=True)
    curvature = drive["curvature_per_m"][first]
    is_known = np.isfinite(curvature)
    begin_m, end_m = (places_m[0], places_m[-1]) if len(places_m) else (0.0, 0.0)
    along_m = np.arange(begin_m - AHEAD_M, end_m + AHEAD_M, STEP_M)
    found = np.zeros_like(along_m)
    if is_known.any():
        found = np.interp(along_m, places_m[is_known], curvature[is_known], 0.0, 0.0)
    return RoadLine(along_m, found, np.full_like(along_m, np.nan))
