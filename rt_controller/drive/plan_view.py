"""A drive in the plane: its road, path, car and predictions, seen from above.

x and y are in metres; the origin is the road's reference line at the first place of the drive,
x along its tangent there, y to the left.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.drive.scenario import Outline, RoadLine
from rt_controller.drive.table import Drive, filled

STEP_M = 0.5
"""between two places of a road that the drive itself has to show"""
AHEAD_M = 10.0
"""of a road that ends with the drive: the car stands on it"""
HALF_LANE_M = 1.75
"""of a nominal lane around the path"""
MARGIN_M, MARGIN = 8.0, 0.04
"""around a whole drive, at least, and as a share of its size"""
NOSE = 0.2
"""share of the body that is pointed"""


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
    lines: dict[str, Line]
    """what stands still, by its kind: "centre" (the reference line), "edge" (of lanes or of the
    road of the scenario), "nominal" (edges of a lane around the path, where there are no others),
    "path" (of each tick, beside the car), "cone" """
    car: Poses
    """of each tick: of a simulated car its true pose"""
    horizons: dict[int, Line]
    """predicted positions, from now on, of the ticks whose plan was recorded"""


def plan_view(drive: Drive) -> PlanView:
    """The drive in the plane.

    Without a scenario the road is the one whose curvature was received.
    """
    s_m, ey_m, epsi_rad = drive.poses.T
    line, scenario = _driven_line(drive, s_m), drive.scenario
    if scenario is not None and scenario.road is not None:
        line = scenario.road
    road = _place_road(line, s_m[0] if len(s_m) else 0.0)
    lanes = () if scenario is None else scenario.lanes
    edges = [
        road.at(np.append(np.arange(lane.start_m, lane.end_m, STEP_M), lane.end_m), side_m)
        for lane in lanes
        for side_m in (lane.right_m, lane.left_m)
    ]
    if not edges and np.isfinite(line.half_width_m).any():
        edges = [road.at(line.s_m, side * line.half_width_m) for side in (-1.0, 1.0)]
    path_m = drive["path_ey_m"]
    sides_m = () if edges else (path_m - HALF_LANE_M, path_m + HALF_LANE_M)
    cones = () if scenario is None else scenario.cones
    lines = {
        "centre": Line(road.x_m, road.y_m),
        "edge": _joined(edges),
        "nominal": _joined([road.at(s_m, side_m) for side_m in sides_m]),
        "path": road.at(s_m, path_m),
        "cone": _joined([road.at(np.array([cone.s_m]), cone.ey_m) for cone in cones]),
    }
    horizons = {each.tick: road.at(each.s_m, each.ey_m) for each in drive.horizons}
    return PlanView(road, lines, road.poses(s_m, ey_m, epsi_rad), horizons)


def extent(views: Iterable[PlanView]) -> tuple[Array, Array]:
    """Lower left and upper right corner (2,) of the part that contains the whole drives."""
    points = np.hstack([(view.car.x_m, view.car.y_m) for view in views])
    low, high = points.min(axis=1), points.max(axis=1)
    margin_m = max(MARGIN_M, MARGIN * float(max(high - low)))
    return low - margin_m, high + margin_m


def outline(body: Outline) -> Line:
    """The corners of the body around its centre of gravity, x forwards; the front is pointed."""
    front_m, rear_m, side_m = body.front_m, -body.rear_m, 0.5 * body.width_m
    shoulder_m = front_m - NOSE * (front_m - rear_m)
    return Line(
        np.array([rear_m, shoulder_m, front_m, shoulder_m, rear_m]),
        np.array([-side_m, -side_m, 0.0, side_m, side_m]),
    )


def corners(car: Poses, tick: int, body: Outline) -> Line:
    """The corners of the car in this tick."""
    along_m, left_m = outline(body)
    x_m, y_m, yaw_rad = (float(each[tick]) for each in car)
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return Line(x_m + cos * along_m - sin * left_m, y_m + sin * along_m + cos * left_m)


def readings(drive: Drive) -> list[str]:
    """Time, speed, lateral error, steering wheel and mode of each tick for people."""
    error_mm = 1e3 * filled(drive.poses[:, 1] - drive["path_ey_m"])
    kmh, wheel_deg = 3.6 * filled(drive["vx_mps"]), np.degrees(drive["steer_rad"])
    rows = zip(drive["time_s"], kmh, error_mm, wheel_deg, drive.modes, strict=True)
    return [
        f"{time_s:.2f} s · {speed:.0f} km/h · lateral error {error:+.0f} mm · steering wheel "
        f"{wheel:+.1f} deg · {mode.name}"
        for time_s, speed, error, wheel, mode in rows
    ]


def _joined(lines: Iterable[Line]) -> Line:
    """The lines as one, with a gap after each."""
    gap = np.full((2, 1), np.nan)
    return Line(*np.hstack([np.empty((2, 0)), *(p for line in lines for p in (line, gap))]))


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
