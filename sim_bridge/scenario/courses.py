"""Cones and lanes along a road, the body that has to pass them, the path between them.

Places are arc length and lateral deviation. Near the car the road is taken as a circle of its local
curvature, so that the body keeps its shape on a curved road.

The lateral zero of a course is the middle of the first lane, or the line of the cones of the
slalom. Lengths and widths of the lanes are those of ISO 3888-1:2018 and ISO 3888-2:2011; the
distance between the cones inside a section, and the clearance of the path, are this project's
choice.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from math import ceil, inf, pi
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

from rt_controller.contract.arrays import Array
from rt_controller.drive.scenario import ConeAt, LaneAt
from sim_bridge.scenario.lateral import Lateral
from sim_bridge.scenario.table import Interpolation, Table, through
from sim_bridge.toml_file import FileTable, Number

CONE_RADIUS_M = 0.14
"""of the base of a cone"""
CONE_SPACING_M = 5.0
"""largest distance between the cones along one edge of a section"""
PATH_GRID_M = 0.5
LEAD_M = 30.0
"""before the first and after the last lane the path may deviate for so far"""
CHANGE_WEIGHT_M = 6.0
"""of the peak change of curvature against the peak curvature"""
_SIDE_POINTS = 5
"""points along each side of the body that are kept in the lane"""
_STRAIGHT_PER_M = 1e-9
_POSES_BETWEEN = 8
"""poses that are checked for each period: 0.1 m apart at 120 km/h"""


class Body(FileTable):
    """`[body]`: outline of the car from above, a rectangle around its centre of gravity."""

    width_m: Annotated[Number, Field(ge=0.5, le=4.0)] = 1.80
    """of the outline of the car, for lanes and cones"""
    front_m: Annotated[Number, Field(ge=0.3, le=10.0)] = 1.90
    """from the centre of gravity to the front end"""
    rear_m: Annotated[Number, Field(ge=0.3, le=10.0)] = 2.45
    """from the centre of gravity to the rear end"""


@dataclass(frozen=True, slots=True)
class Course:
    """Cones and lanes of a manoeuvre."""

    body: Body = field(default_factory=Body)
    cones: tuple[ConeAt, ...] = ()
    lanes: tuple[LaneAt, ...] = ()


class Poses(NamedTuple):
    """A drive on its road, (n,) each."""

    s_m: Array
    ey_m: Array
    epsi_rad: Array
    curvature_per_m: Array


def cone_hits(course: Course, poses: Poses) -> int:
    """Number of cones that the body touched."""
    fine = _refined(poses)
    body = course.body
    hits = 0
    for cone in course.cones:
        near = np.abs(fine.s_m - cone.s_m) < 2.0 * max(body.front_m, body.rear_m)
        forward_m, left_m = _seen_from_body(cone, Poses(*(part[near] for part in fine)))
        beyond = np.maximum(np.maximum(forward_m - body.front_m, -body.rear_m - forward_m), 0.0)
        beside = np.maximum(np.abs(left_m) - 0.5 * body.width_m, 0.0)
        hits += bool(np.any(np.hypot(beyond, beside) < CONE_RADIUS_M))
    return hits


def lane_margin_m(course: Course, poses: Poses) -> float:
    """Smallest distance of a corner of the body to an edge of its lane.

    Negative if a corner crossed an edge; inf if the car was in no lane.
    """
    margin_m = inf
    for s_m, ey_m in _corners(course.body, poses):
        for lane in course.lanes:
            inside = (s_m >= lane.start_m) & (s_m <= lane.end_m)
            if np.any(inside):
                gap_m = np.minimum(lane.left_m - ey_m[inside], ey_m[inside] - lane.right_m)
                margin_m = min(margin_m, float(gap_m.min()))
    return margin_m


def road_margin_m(body: Body, poses: Poses, width_m: Table) -> float:
    """Smallest distance of a corner of the body to an edge of the road; negative: beside it."""
    return min(
        float(np.min(0.5 * width_m(s_m) - np.abs(ey_m))) for s_m, ey_m in _corners(body, poses)
    )


def _corners(body: Body, poses: Poses) -> Iterator[tuple[Array, Array]]:
    """(arc length, lateral deviation) of each corner during the drive."""
    fine = _refined(poses)
    c, s = np.cos(fine.epsi_rad), np.sin(fine.epsi_rad)
    kappa = _not_straight(fine.curvature_per_m)
    for forward_m in (body.front_m, -body.rear_m):
        for left_m in (0.5 * body.width_m, -0.5 * body.width_m):
            along = forward_m * c - left_m * s
            gap = 1.0 - kappa * (fine.ey_m + forward_m * s + left_m * c)
            s_m = fine.s_m + np.arctan2(kappa * along, gap) / kappa
            yield s_m, (1.0 - np.hypot(kappa * along, gap)) / kappa


def _seen_from_body(cone: ConeAt, poses: Poses) -> tuple[Array, Array]:
    """(forward, left) distance of a cone from the centre of gravity, in axes of the body."""
    kappa = _not_straight(poses.curvature_per_m)
    turn = kappa * (cone.s_m - poses.s_m)
    gap = 1.0 - kappa * cone.ey_m
    along = gap * np.sin(turn) / kappa
    across = (1.0 - gap * np.cos(turn)) / kappa - poses.ey_m
    c, s = np.cos(poses.epsi_rad), np.sin(poses.epsi_rad)
    return along * c + across * s, across * c - along * s


def _not_straight(curvature_per_m: Array) -> Array:
    """The curvature, with a circle of 10^9 m instead of a straight line."""
    return np.where(np.abs(curvature_per_m) < _STRAIGHT_PER_M, _STRAIGHT_PER_M, curvature_per_m)


def _refined(poses: Poses) -> Poses:
    """The drive with further poses between those of the periods."""
    n = len(poses.s_m)
    x = np.linspace(0.0, n - 1.0, (n - 1) * _POSES_BETWEEN + 1)
    return Poses(*(np.interp(x, np.arange(n), part) for part in poses))


_Start = Annotated[Number, Field(ge=0.0, le=1e6)]
_Clearance = Annotated[Number, Field(ge=0.0, le=5.0)]


class Slalom(FileTable):
    """Cones in a row, passed in turn on the left and on the right, beginning on the left.

    Between the first and the last cone the path is a sine whose peaks are at the cones.
    """

    kind: Literal["slalom"]
    start_s_m: _Start
    spacing_m: Annotated[Number, Field(ge=5.0, le=200.0)]
    cones: Annotated[int, Field(ge=2, le=100, strict=True)]
    clearance_m: _Clearance = 0.3
    """between body and cones"""

    def driven_by(self, body: Body) -> tuple[Course, Lateral]:
        """Cones and path."""
        spacing_m, cones = self.spacing_m, self.cones
        amplitude_m = 0.5 * body.width_m + CONE_RADIUS_M + self.clearance_m
        first_m = self.start_s_m + 1.5 * spacing_m
        s_m = np.linspace(0.0, (cones - 1) * spacing_m, 16 * (cones - 1) + 1)
        ey_m = amplitude_m * np.cos(pi * s_m / spacing_m)
        x = [self.start_s_m, *(first_m + s_m).tolist(), first_m + (cones + 0.5) * spacing_m]
        path = through(x, [0.0, *ey_m.tolist(), 0.0], Interpolation.SPLINE)
        placed = tuple(ConeAt(first_m + k * spacing_m, 0.0) for k in range(cones))
        return Course(body, placed), Lateral(path)


class IsoLaneChange(FileTable):
    """The severe lane change of part 1, or the obstacle avoidance of part 2.

    The second lane begins 3.5 m left of the right edge of the first one, or 1 m left of its left
    edge.
    """

    kind: Literal["iso_3888_1", "iso_3888_2"]
    start_s_m: _Start
    """beginning of the first lane"""
    clearance_m: _Clearance = 0.1
    """of the path to the edges of the lanes"""

    def driven_by(self, body: Body) -> tuple[Course, Lateral]:
        """Lanes, cones and path.

        Raises:
            ValueError: the body does not fit into the lanes.
        """
        w = body.width_m
        first_m, last_m = 1.1 * w + 0.25, 1.3 * w + 0.25
        sections: tuple[tuple[float, ...], ...] = (
            (15.0, 0.0, first_m), (30.0,), (25.0, 3.5, 1.2 * w + 0.25), (25.0,),
            (15.0, 0.0, last_m), (15.0, 0.0, last_m),
        )  # fmt: skip
        if self.kind == "iso_3888_2":
            sections = (
                (12.0, 0.0, first_m), (13.5,), (11.0, first_m + 1.0, w + 1.0), (12.5,),
                (12.0, 0.0, max(last_m, 3.0)),
            )  # fmt: skip
        lanes, at_m = [], self.start_s_m
        for length_m, *lane in sections:  # right edge from that of the first lane, and width
            if lane:
                right_m = lane[0] - 0.5 * first_m
                lanes.append(LaneAt(at_m, at_m + length_m, right_m, right_m + lane[1]))
            at_m += length_m
        cones = {cone for each in lanes for cone in _cones_of(each)}
        course = Course(body, tuple(sorted(cones)), tuple(lanes))
        return course, Lateral(smoothest_path(course.lanes, body, self.clearance_m))


def _cones_of(lane: LaneAt) -> list[ConeAt]:
    """Cones on both edges; their bases touch the lane from outside."""
    count = ceil((lane.end_m - lane.start_m) / CONE_SPACING_M - 1e-9) + 1
    return [
        ConeAt(float(s_m), ey_m)
        for s_m in np.linspace(lane.start_m, lane.end_m, count)
        for ey_m in (lane.right_m - CONE_RADIUS_M, lane.left_m + CONE_RADIUS_M)
    ]


@lru_cache(maxsize=4)
def smoothest_path(lanes: tuple[LaneAt, ...], body: Body, clearance_m: float) -> Table:
    """The path of least curvature: position of the centre of gravity over arc length.

    It starts on e_y = 0 and ends in the middle of the last lane, straight before and after. It is
    a linear program in the lateral positions on a grid. The body, taken as parallel to the path,
    stays inside every lane with a clearance; minimised is the peak of the curvature, and with a
    smaller weight the peak of its change, which the steering rate limits.

    Raises:
        ValueError: the body with its clearance does not fit into the lanes.
    """
    from scipy.optimize import linprog

    first_m = lanes[0].start_m - LEAD_M
    n = round((lanes[-1].end_m + LEAD_M - first_m) / PATH_GRID_M) + 1
    s_m = first_m + PATH_GRID_M * np.arange(n)
    half_m = 0.5 * body.width_m + clearance_m
    unknowns = np.eye(n, n + 2)
    """the positions, the peak of the curvature and that of its change"""
    rows: list[Array] = []
    limits: list[float] = []
    for forward_m in np.linspace(-body.rear_m, body.front_m, _SIDE_POINTS):
        lever = 0.5 * forward_m / PATH_GRID_M
        for i in range(1, n - 1):
            place = unknowns[i] + lever * (unknowns[i + 1] - unknowns[i - 1])
            for lane in lanes:
                if lane.start_m <= s_m[i] + forward_m <= lane.end_m:
                    rows += [place, -place]
                    limits += [lane.left_m - half_m, -lane.right_m - half_m]
    for order in (2, 3):
        derivative = np.diff(unknowns, order, axis=0) / PATH_GRID_M**order
        peak = np.zeros(n + 2)
        peak[n + order - 2] = 1.0
        rows += [*(derivative - peak), *(-derivative - peak)]
        limits += [0.0] * (2 * len(derivative))
    middle_m = 0.5 * (lanes[-1].right_m + lanes[-1].left_m)
    found = linprog(
        np.concatenate((np.zeros(n), (1.0, CHANGE_WEIGHT_M))),
        A_ub=np.array(rows),
        b_ub=limits,
        A_eq=unknowns[[0, 1, 2, n - 3, n - 2, n - 1]],
        b_eq=[0.0, 0.0, 0.0, middle_m, middle_m, middle_m],
        bounds=(None, None),
        method="highs",
    )
    if found.status != 0:
        raise ValueError(
            f"reference.ey_m.clearance_m: expected lanes that a body {body.width_m:g} m wide fits "
            f"into with it, found {clearance_m:g}. Make it smaller."
        )
    return through(s_m.tolist(), found.x[:n].tolist(), Interpolation.SPLINE)
