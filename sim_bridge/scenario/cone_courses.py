"""Cone courses: the two lane changes of ISO 3888 and the slalom.

The lateral zero is the middle of the first lane, or the line of the cones of the slalom. Lengths
and widths of the lanes are those of ISO 3888-1:2018 and ISO 3888-2:2011; the distance between the
cones inside a section, and the clearance of the path, are this project's choice.
"""

from math import ceil, pi
from typing import NamedTuple

import numpy as np

from sim_bridge.scenario.lane_path import smoothest_path
from sim_bridge.scenario.lanes import CONE_RADIUS_M, Body, Cone, Course, Lane
from sim_bridge.scenario.lateral import Lateral, LateralTable
from sim_bridge.scenario.table import Interpolation, through

CONE_SPACING_M = 5.0
"""largest distance between the cones along one edge of a section"""


class _Section(NamedTuple):
    """A section of an ISO course: its length, and its lane where it has one."""

    length_m: float
    right_m: float = 0.0
    """of the right edge from that of the first lane"""
    width_m: float = 0.0
    """0: between two lanes"""


class ConeCourse(NamedTuple):
    """A course and the path through it."""

    course: Course
    lateral: Lateral


def iso_3888_1(start_m: float, body: Body, clearance_m: float) -> ConeCourse:
    """The severe lane change; the second lane begins 3.5 m left of the right edge of the first."""
    w = body.width_m
    sections = (
        _Section(15.0, 0.0, 1.1 * w + 0.25),
        _Section(30.0),
        _Section(25.0, 3.5, 1.2 * w + 0.25),
        _Section(25.0),
        _Section(15.0, 0.0, 1.3 * w + 0.25),
        _Section(15.0, 0.0, 1.3 * w + 0.25),
    )
    return _through_lanes(sections, start_m, body, clearance_m)


def iso_3888_2(start_m: float, body: Body, clearance_m: float) -> ConeCourse:
    """The obstacle avoidance; the second lane begins 1 m left of the left edge of the first."""
    w = body.width_m
    first_m = 1.1 * w + 0.25
    sections = (
        _Section(12.0, 0.0, first_m),
        _Section(13.5),
        _Section(11.0, first_m + 1.0, w + 1.0),
        _Section(12.5),
        _Section(12.0, 0.0, max(1.3 * w + 0.25, 3.0)),
    )
    return _through_lanes(sections, start_m, body, clearance_m)


def slalom(
    start_m: float, spacing_m: float, cones: int, body: Body, clearance_m: float
) -> ConeCourse:
    """Cones in a row, passed in turn on the left and on the right, beginning on the left.

    Between the first and the last cone the path is a sine whose peaks are at the cones.
    """
    amplitude_m = 0.5 * body.width_m + CONE_RADIUS_M + clearance_m
    first_m = start_m + 1.5 * spacing_m
    s_m = np.linspace(0.0, (cones - 1) * spacing_m, 16 * (cones - 1) + 1)
    ey_m = amplitude_m * np.cos(pi * s_m / spacing_m)
    x = [start_m, *(first_m + s_m).tolist(), first_m + (cones + 0.5) * spacing_m]
    path = through(x, [0.0, *ey_m.tolist(), 0.0], Interpolation.SPLINE)
    placed = tuple(Cone(first_m + k * spacing_m, 0.0) for k in range(cones))
    return ConeCourse(Course(body, placed), LateralTable(path))


def _through_lanes(
    sections: tuple[_Section, ...], start_m: float, body: Body, clearance_m: float
) -> ConeCourse:
    middle_m = sections[0].right_m + 0.5 * sections[0].width_m
    lanes, at_m = [], start_m
    for section in sections:
        if section.width_m > 0.0:
            right_m = section.right_m - middle_m
            lanes.append(Lane(at_m, at_m + section.length_m, right_m, right_m + section.width_m))
        at_m += section.length_m
    cones = {cone for lane in lanes for cone in _cones_of(lane)}
    course = Course(body, tuple(sorted(cones)), tuple(lanes))
    return ConeCourse(course, LateralTable(smoothest_path(lanes, body, clearance_m)))


def _cones_of(lane: Lane) -> list[Cone]:
    """Cones on both edges; their bases touch the lane from outside."""
    count = ceil((lane.end_m - lane.start_m) / CONE_SPACING_M - 1e-9) + 1
    return [
        Cone(float(s_m), ey_m)
        for s_m in np.linspace(lane.start_m, lane.end_m, count)
        for ey_m in (lane.right_m - CONE_RADIUS_M, lane.left_m + CONE_RADIUS_M)
    ]
