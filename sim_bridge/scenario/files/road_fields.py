"""The table `[road]` of a scenario file."""

from math import inf, radians
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, Tag, model_validator

from rt_controller.contract.limits import LEAST_FRICTION, MOST_FRICTION
from sim_bridge.scenario.courses import Bend, course_of_bends, ramp_of_curvature
from sim_bridge.scenario.files.fields import (
    DISTANCE_TAG,
    NUMBER_TAG,
    DistanceValue,
    NotNegative,
    OverDistance,
    Positive,
    file_name,
    forms,
    kind_tag,
    require_within,
    table_of,
)
from sim_bridge.scenario.limits import (
    DRY_ASPHALT,
    LARGEST_CURVATURE_PER_M,
    SMALLEST_RADIUS_M,
    STEEPEST_BANK_DEG,
    STEEPEST_PERCENT,
)
from sim_bridge.scenario.maps.opendrive import read_reference_line
from sim_bridge.scenario.road import Road
from sim_bridge.scenario.table import Table, constant
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
        sign = 1.0 if self.direction == "left" else -1.0
        if self.entry_s_m == 0.0 and self.spiral_m == 0.0:
            return constant(sign / self.radius_m)
        return ramp_of_curvature(self.entry_s_m, self.spiral_m, 0.0, sign / self.radius_m)


class Spiral(FileTable):
    """A clothoid: curvature that changes linearly with arc length."""

    kind: Literal["spiral"]
    start_s_m: NotNegative
    length_m: Positive
    from_per_m: _Curvature = 0.0
    to_per_m: _Curvature

    def table(self) -> Table:
        """Curvature in 1/m."""
        return ramp_of_curvature(self.start_s_m, self.length_m, self.from_per_m, self.to_per_m)


class Step(FileTable):
    """A jump of curvature."""

    kind: Literal["step"]
    at_s_m: NotNegative
    from_per_m: _Curvature = 0.0
    to_per_m: _Curvature

    def table(self) -> Table:
        """Curvature in 1/m."""
        return ramp_of_curvature(self.at_s_m, 0.0, self.from_per_m, self.to_per_m)


class BendFields(FileTable):
    """One bend of a course, or a straight."""

    straight_m: NotNegative = 0.0
    """before the bend"""
    radius_m: _Radius | None = None
    turn_deg: Annotated[Number, Field(ge=-720.0, le=720.0)] = 0.0
    """change of heading, positive to the left"""
    spiral_m: NotNegative = 0.0
    """length of the clothoid at each end of the bend"""

    @model_validator(mode="after")
    def _require_bend(self) -> Self:
        if (self.radius_m is None) != (self.turn_deg == 0.0):
            raise ValueError("turn_deg: expected together with radius_m, found one of them alone")
        if self.radius_m is None and (self.straight_m == 0.0 or self.spiral_m > 0.0):
            raise ValueError("straight_m: expected a straight or a bend with radius_m, found none")
        if self.bend.arc_m < 0.0:
            raise ValueError(
                f"spiral_m: expected at most radius_m times the turn, "
                f"{self.bend.arc_m + self.spiral_m:g}, found {self.spiral_m:g}"
            )
        return self

    @property
    def bend(self) -> Bend:
        """The part of the course."""
        return Bend(self.straight_m, self.radius_m or 0.0, radians(self.turn_deg), self.spiral_m)


class CourseFields(FileTable):
    """Straights and bends in a row."""

    kind: Literal["course"]
    bends: Annotated[tuple[BendFields, ...], at_most(1000), AfterValidator(not_empty)]

    def table(self) -> Table:
        """Curvature in 1/m."""
        return course_of_bends([fields.bend for fields in self.bends])


class OpenDriveFields(FileTable):
    """The reference line of roads in an OpenDRIVE file."""

    file: Annotated[Path, AfterValidator(file_name)]
    """relative to the folder of the scenario file"""
    roads: tuple[str, ...] = ()
    """ids in driving order, with a minus sign if against the reference line"""
    flat: bool = False
    """leave out elevation and superelevation"""


_CurvatureValue = Annotated[
    Annotated[Number, Tag(NUMBER_TAG)]
    | Annotated[OverDistance, Tag(DISTANCE_TAG)]
    | Annotated[Circle, Tag(kind_tag("circle"))]
    | Annotated[Spiral, Tag(kind_tag("spiral"))]
    | Annotated[Step, Tag(kind_tag("step"))]
    | Annotated[CourseFields, Tag(kind_tag("course"))],
    forms(
        "a number, a table with s_m and value, or kind = circle, spiral, step or course with its "
        "fields"
    ),
]
_Curvatures = float | OverDistance | Circle | Spiral | Step | CourseFields


def _curvature_table(value: _Curvatures) -> Table:
    return constant(value) if isinstance(value, int | float) else value.table()


def _within_frames(value: _Curvatures) -> _Curvatures:
    largest = LARGEST_CURVATURE_PER_M
    require_within(_curvature_table(value), -largest, largest, " 1/m")
    return value


def _real_friction(value: float | OverDistance) -> float | OverDistance:
    require_within(table_of(value), LEAST_FRICTION, MOST_FRICTION, "")
    return value


def _gentle_bank(value: float | OverDistance) -> float | OverDistance:
    require_within(table_of(value), -STEEPEST_BANK_DEG, STEEPEST_BANK_DEG, " deg")
    return value


def _gentle_grade(value: float | OverDistance) -> float | OverDistance:
    require_within(table_of(value), -STEEPEST_PERCENT, STEEPEST_PERCENT, " %")
    return value


def _real_width(value: float | OverDistance) -> float | OverDistance:
    require_within(table_of(value), 2.0, 100.0, " m")
    return value


_Friction = Annotated[DistanceValue, AfterValidator(_real_friction)]


class RoadFields(FileTable):
    """`[road]`: the reference line and the ground along it."""

    curvature_per_m: Annotated[_CurvatureValue, AfterValidator(_within_frames)] = 0.0
    opendrive: OpenDriveFields | None = None
    friction: _Friction | None = None
    """both sides; 1 is the road of the tyre test"""
    friction_left: _Friction | None = None
    friction_right: _Friction | None = None
    bank_deg: Annotated[DistanceValue, AfterValidator(_gentle_bank)] = 0.0
    grade_percent: Annotated[DistanceValue, AfterValidator(_gentle_grade)] = 0.0
    width_m: Annotated[DistanceValue, AfterValidator(_real_width)] | None = None
    length_m: Positive | None = None

    @model_validator(mode="after")
    def _require_one_source(self) -> Self:
        sides = (self.friction_left, self.friction_right)
        if self.friction is not None and sides != (None, None):
            raise ValueError("friction: expected it, or friction_left and friction_right, not both")
        if (self.friction_left is None) != (self.friction_right is None):
            raise ValueError("friction_left: expected together with friction_right, found one")
        if self.opendrive is not None:
            named = {"curvature_per_m", "bank_deg", "grade_percent", "length_m"}
            both = sorted(named & self.model_fields_set)
            if both:
                raise ValueError(f"{both[0]}: expected none beside opendrive, which contains it")
        return self

    def road(self, folder: Path) -> Road:
        """The road; `folder` is that of the scenario file.

        Raises:
            ConfigError: the OpenDRIVE file cannot be used.
        """
        friction = DRY_ASPHALT if self.friction is None else self.friction
        left = friction if self.friction_left is None else self.friction_left
        right = friction if self.friction_right is None else self.friction_right
        width_m = None if self.width_m is None else table_of(self.width_m)
        source = self.opendrive
        if source is None:
            return Road(
                curvature_per_m=_curvature_table(self.curvature_per_m),
                friction_left=table_of(left),
                friction_right=table_of(right),
                bank_rad=table_of(self.bank_deg).scaled(radians(1.0)),
                grade=table_of(self.grade_percent).scaled(0.01),
                width_m=width_m,
                length_m=inf if self.length_m is None else self.length_m,
            )
        line = read_reference_line(folder / source.file, source.roads)
        return Road(
            curvature_per_m=line.curvature_per_m,
            friction_left=table_of(left),
            friction_right=table_of(right),
            bank_rad=constant(0.0) if source.flat else line.bank_rad,
            grade=constant(0.0) if source.flat else line.grade,
            width_m=width_m,
            length_m=line.length_m,
        )
