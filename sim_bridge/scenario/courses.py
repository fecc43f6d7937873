"""Generators of curvature over arc length: circle, ramp or step, and a course of bends."""

from collections.abc import Sequence
from typing import NamedTuple

from sim_bridge.scenario.table import Ramp, Table, chained


class Bend(NamedTuple):
    """A part of a course: a straight, or a bend between two clothoids."""

    straight_m: float = 0.0
    """before the bend"""
    radius_m: float = 0.0
    """0: no bend"""
    turn_rad: float = 0.0
    """change of heading over the whole bend, positive to the left"""
    spiral_m: float = 0.0
    """length of the clothoid at each end of the bend"""

    @property
    def arc_m(self) -> float:
        """Length of the part of constant curvature; the clothoids turn by half as much."""
        return abs(self.turn_rad) * self.radius_m - self.spiral_m


def course_of_bends(bends: Sequence[Bend]) -> Table:
    """The curvature of straights and bends in a row; straight after the last one."""
    ramps = []
    for bend in bends:
        if bend.straight_m > 0.0:
            ramps.append(Ramp(bend.straight_m, 0.0, 0.0))
        if bend.radius_m > 0.0:
            peak = (1.0 if bend.turn_rad > 0.0 else -1.0) / bend.radius_m
            if bend.spiral_m > 0.0:
                ramps.append(Ramp(bend.spiral_m, 0.0, peak))
            if bend.arc_m > 0.0:
                ramps.append(Ramp(bend.arc_m, peak, peak))
            if bend.spiral_m > 0.0:
                ramps.append(Ramp(bend.spiral_m, peak, 0.0))
    return chained([*ramps, Ramp(1.0, 0.0, 0.0)])


def ramp_of_curvature(at_m: float, length_m: float, before_per_m: float, to_per_m: float) -> Table:
    """A clothoid between two constant curvatures; a step if its length is 0."""
    ramps = [] if length_m == 0.0 else [Ramp(length_m, before_per_m, to_per_m)]
    parts = [Ramp(1.0, before_per_m, before_per_m), *ramps, Ramp(1.0, to_per_m, to_per_m)]
    return chained(parts, at_m - 1.0)
