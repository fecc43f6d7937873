"""Cone courses: the two lane changes of ISO 3888 and the slalom.

The lateral zero is the middle of the first lane, or the line of the cones of the slalom. Lengths
and widths of the lanes are those of ISO 3888-1:2018 and ISO 3888-2:2011; the distance between the
cones inside a section, and the clearance of the path, are this project's choice.
"""

from math import ceil, pi
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

from sim_bridge.scenario.lane_path import smoothest_path
from sim_bridge.scenario.lanes import CONE_RADIUS_M, Body, Cone, Course, Lane
from sim_bridge.scenario.lateral import Lateral, LateralTable
from sim_bridge.scenario.table import Interpolation, through
from sim_bridge.scenario.values import NotNegative
from sim_bridge.toml_file import FileTable, Number

CONE_SPACING_M = 5.0
"""largest distance between the cones along one edge of a section"""
_Clearance = Annotated[Number, Field(ge=0.0, le=5.0)]


class ConeCourse(NamedTuple):
    """A course and the path through it."""

    course: Course
    lateral: Lateral


class Slalom(FileTable):
    """Cones in a row, passed in turn on the left and on the right, beginning on the left.

    Between the first and the last cone the path is a sine whose peaks are at the cones.
    """

    kind: Literal["slalom"]
    start_s_m: NotNegative
    spacing_m: Annotated[Number, Field(ge=5.0, le=200.0)]
    cones: Annotated[int, Field(ge=2, le=100, strict=True)]
    clearance_m: _Clearance = 0.3
    """between body and cones"""

    def driven_by(self, body: Body) -> ConeCourse:
        """Cones and path."""
        spacing_m, cones = self.spacing_m, self.cones
        amplitude_m = 0.5 * body.width_m + CONE_RADIUS_M + self.clearance_m
        first_m = self.start_s_m + 1.5 * spacing_m
        s_m = np.linspace(0.0, (cones - 1) * spacing_m, 16 * (cones - 1) + 1)
        ey_m = amplitude_m * np.cos(pi * s_m / spacing_m)
        x = [self.start_s_m, *(first_m + s_m).tolist(), first_m + (cones + 0.5) * spacing_m]
        path = through(x, [0.0, *ey_m.tolist(), 0.0], Interpolation.SPLINE)
        placed = tuple(Cone(first_m + k * spacing_m, 0.0) for k in range(cones))
        return ConeCourse(Course(body, placed), LateralTable(path))


class IsoLaneChange(FileTable):
    """The severe lane change of part 1, or the obstacle avoidance of part 2.

    The second lane begins 3.5 m left of the right edge of the first one, or 1 m left of its left
    edge.
    """

    kind: Literal["iso_3888_1", "iso_3888_2"]
    start_s_m: NotNegative
    """beginning of the first lane"""
    clearance_m: _Clearance = 0.1
    """of the path to the edges of the lanes"""

    def driven_by(self, body: Body) -> ConeCourse:
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
                lanes.append(Lane(at_m, at_m + length_m, right_m, right_m + lane[1]))
            at_m += length_m
        cones = {cone for each in lanes for cone in _cones_of(each)}
        course = Course(body, tuple(sorted(cones)), tuple(lanes))
        return ConeCourse(course, LateralTable(smoothest_path(lanes, body, self.clearance_m)))


def _cones_of(lane: Lane) -> list[Cone]:
    """Cones on both edges; their bases touch the lane from outside."""
    count = ceil((lane.end_m - lane.start_m) / CONE_SPACING_M - 1e-9) + 1
    return [
        Cone(float(s_m), ey_m)
        for s_m in np.linspace(lane.start_m, lane.end_m, count)
        for ey_m in (lane.right_m - CONE_RADIUS_M, lane.left_m + CONE_RADIUS_M)
    ]
