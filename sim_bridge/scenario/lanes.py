"""Cones and lanes along a road, the body that has to pass them, and whether it did.

Places are arc length and lateral deviation. Near the car the road is taken as a circle of its local
curvature, so that the body keeps its shape on a curved road.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import inf
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from rt_controller.contract.arrays import Array
from sim_bridge.scenario.table import Table
from sim_bridge.toml_file import FileTable, Number

CONE_RADIUS_M = 0.14
"""of the base of a cone"""
_STRAIGHT_PER_M = 1e-9
_POSES_BETWEEN = 8
"""poses that are checked for each period: 0.1 m apart at 120 km/h"""


class Body(FileTable):
    """`[body]`: outline of the car from above, a rectangle around its centre of gravity."""

    width_m: Annotated[Number, Field(ge=0.5, le=4.0)] = 1.80
    front_m: Annotated[Number, Field(ge=0.3, le=10.0)] = 1.90
    """from the centre of gravity to the front end"""
    rear_m: Annotated[Number, Field(ge=0.3, le=10.0)] = 2.45


class Cone(NamedTuple):
    """A cone on the road."""

    s_m: float
    ey_m: float


class Lane(NamedTuple):
    """A section that no part of the body may leave."""

    start_m: float
    end_m: float
    right_m: float
    """lateral position of its right edge"""
    left_m: float


@dataclass(frozen=True, slots=True)
class Course:
    """Cones and lanes of a manoeuvre."""

    body: Body = field(default_factory=Body)
    cones: tuple[Cone, ...] = ()
    lanes: tuple[Lane, ...] = ()


class Poses(NamedTuple):
    """A drive on its road, (n,) each."""

    s_m: Array
    ey_m: Array
    epsi_rad: Array
    curvature_per_m: Array


def cone_hits(course: Course, poses: Poses) -> int:
    """Number of cones that the body touched."""
    if not course.cones:
        return 0
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
    for forward_m in (body.front_m, -body.rear_m):
        for left_m in (0.5 * body.width_m, -0.5 * body.width_m):
            yield _corner(forward_m, left_m, fine)


def _corner(forward_m: float, left_m: float, poses: Poses) -> tuple[Array, Array]:
    """(arc length, lateral deviation) of a point of the body."""
    c, s = np.cos(poses.epsi_rad), np.sin(poses.epsi_rad)
    along = forward_m * c - left_m * s
    across = poses.ey_m + forward_m * s + left_m * c
    kappa = _not_straight(poses.curvature_per_m)
    gap = 1.0 - kappa * across
    return (
        poses.s_m + np.arctan2(kappa * along, gap) / kappa,
        (1.0 - np.hypot(kappa * along, gap)) / kappa,
    )


def _seen_from_body(cone: Cone, poses: Poses) -> tuple[Array, Array]:
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
