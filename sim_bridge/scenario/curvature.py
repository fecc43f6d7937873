"""Kinds of curvature over arc length: circle, spiral, step, and a course of bends."""

from math import radians
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from sim_bridge.scenario.limits import LARGEST_CURVATURE_PER_M, SMALLEST_RADIUS_M
from sim_bridge.scenario.table import Ramp, Table, chained, constant
from sim_bridge.scenario.values import NotNegative, Positive
from sim_bridge.toml_file import FileTable, Number, at_most, not_empty

_Radius = Annotated[Number, Field(ge=SMALLEST_RADIUS_M)]
_Curvature = Annotated[Number, Field(ge=-LARGEST_CURVATURE_PER_M, le=LARGEST_CURVATURE_PER_M)]


class Circle(FileTable):
    """A circle, entered from a straight."""

    kind: Literal["circle"]
    radius_m: _Radius
    direction: Literal["left", "right"] = "left"
    entry_s_m: NotNegative = 0.0
    """end of the straight; 0: no straight"""
    spiral_m: NotNegative = 0.0
    """length of the clothoid after the straight"""

    def table(self) -> Table:
        """Curvature in 1/m."""
        per_m = (1.0 if self.direction == "left" else -1.0) / self.radius_m
        if self.entry_s_m == 0.0 and self.spiral_m == 0.0:
            return constant(per_m)
        return _ramp(self.entry_s_m, self.spiral_m, 0.0, per_m)


class Spiral(FileTable):
    """A clothoid: curvature that changes linearly with arc length."""

    kind: Literal["spiral"]
    start_s_m: NotNegative
    length_m: Positive
    from_per_m: _Curvature = 0.0
    to_per_m: _Curvature

    def table(self) -> Table:
        """Curvature in 1/m."""
        return _ramp(self.start_s_m, self.length_m, self.from_per_m, self.to_per_m)


class Step(FileTable):
    """A jump of curvature."""

    kind: Literal["step"]
    at_s_m: NotNegative
    from_per_m: _Curvature = 0.0
    to_per_m: _Curvature

    def table(self) -> Table:
        """Curvature in 1/m."""
        return _ramp(self.at_s_m, 0.0, self.from_per_m, self.to_per_m)


class Bend(FileTable):
    """A part of a course: a straight, or a bend between two clothoids."""

    straight_m: NotNegative = 0.0
    """before the bend"""
    radius_m: _Radius | None = None
    turn_deg: Annotated[Number, Field(ge=-720.0, le=720.0)] = 0.0
    """change of heading over the whole bend, positive to the left"""
    spiral_m: NotNegative = 0.0
    """length of the clothoid at each end of the bend"""

    @model_validator(mode="after")
    def _require_bend(self) -> Self:
        if (self.radius_m is None) != (self.turn_deg == 0.0):
            raise ValueError("turn_deg: expected together with radius_m, found one of them alone")
        if self.radius_m is None and (self.straight_m == 0.0 or self.spiral_m > 0.0):
            raise ValueError("straight_m: expected a straight or a bend with radius_m, found none")
        if self._arc_m < 0.0:
            raise ValueError(
                f"spiral_m: expected at most radius_m times the turn, "
                f"{self._arc_m + self.spiral_m:g}, found {self.spiral_m:g}"
            )
        return self

    @property
    def _arc_m(self) -> float:
        """Length of the part of constant curvature; the clothoids turn by half as much."""
        return abs(radians(self.turn_deg)) * (self.radius_m or 0.0) - self.spiral_m

    def ramps(self) -> list[Ramp]:
        """Its parts, without those of no length."""
        parts = [Ramp(self.straight_m, 0.0, 0.0)]
        if self.radius_m is not None:
            peak = (1.0 if self.turn_deg > 0.0 else -1.0) / self.radius_m
            parts.append(Ramp(self.spiral_m, 0.0, peak))
            parts.append(Ramp(self._arc_m, peak, peak))
            parts.append(Ramp(self.spiral_m, peak, 0.0))
        return [part for part in parts if part.length > 0.0]


class CourseOfBends(FileTable):
    """Straights and bends in a row; straight after the last one."""

    kind: Literal["course"]
    bends: Annotated[tuple[Bend, ...], at_most(1000), AfterValidator(not_empty)]

    def table(self) -> Table:
        """Curvature in 1/m."""
        ramps = [ramp for bend in self.bends for ramp in bend.ramps()]
        return chained([*ramps, Ramp(1.0, 0.0, 0.0)])


def _ramp(at_m: float, length_m: float, before_per_m: float, to_per_m: float) -> Table:
    """A clothoid between two constant curvatures; a step if its length is 0."""
    ramps = [] if length_m == 0.0 else [Ramp(length_m, before_per_m, to_per_m)]
    parts = [Ramp(1.0, before_per_m, before_per_m), *ramps, Ramp(1.0, to_per_m, to_per_m)]
    return chained(parts, at_m - 1.0)
