"""`Road`: what the ground of a scenario is like, as tables over the arc length s."""

from collections.abc import Mapping
from functools import cached_property
from math import atan, inf, radians
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from rt_controller.contract.limits import LEAST_FRICTION, MOST_FRICTION
from sim_bridge.plant.protocol import RoadAt
from sim_bridge.scenario.limits import (
    DRY_ASPHALT,
    LARGEST_CURVATURE_PER_M,
    SMALLEST_RADIUS_M,
    STEEPEST_BANK_DEG,
    STEEPEST_PERCENT,
)
from sim_bridge.scenario.opendrive import ReferenceLine, read_reference_line
from sim_bridge.scenario.table import Ramp, Table, chained, constant
from sim_bridge.scenario.values import NotNegative, OverDistance, table_within
from sim_bridge.toml_file import FileTable, Number, entries

_Radius = Annotated[Number, Field(ge=SMALLEST_RADIUS_M)]


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
    bends: Annotated[tuple[Bend, ...], entries(1, 1000)]

    def table(self) -> Table:
        """Curvature in 1/m."""
        ramps = [ramp for bend in self.bends for ramp in bend.ramps()]
        return chained([*ramps, Ramp(1.0, 0.0, 0.0)])


_Curvature = Annotated[
    Table,
    table_within(
        -LARGEST_CURVATURE_PER_M,
        LARGEST_CURVATURE_PER_M,
        "1/m",
        tables={"s_m": OverDistance, "course": CourseOfBends},
    ),
]
_Friction = Annotated[Table, table_within(LEAST_FRICTION, MOST_FRICTION)]
_Bank = Annotated[
    Table, table_within(-STEEPEST_BANK_DEG, STEEPEST_BANK_DEG, "deg", factor=radians(1.0))
]
_Grade = Annotated[Table, table_within(-STEEPEST_PERCENT, STEEPEST_PERCENT, "%", factor=0.01)]
_Length = Annotated[float, Field(gt=0.0, strict=True)]
_Width = Annotated[Table, table_within(2.0, 100.0, "m")]


class OpenDrive(FileTable):
    """The reference line of roads in an OpenDRIVE file."""

    file: Path
    """in a scenario file relative to its folder"""
    roads: tuple[str, ...] = ()
    """ids in driving order, with a minus sign if against the reference line"""
    flat: bool = False
    """leave out elevation and superelevation"""

    @field_validator("file")
    @classmethod
    def _in_folder(cls, file: Path, info: ValidationInfo) -> Path:
        if not file.name:
            raise ValueError(f"expected the name of a file, found {str(file)!r}")
        return (info.context or Path()) / file

    @cached_property
    def line(self) -> ReferenceLine:
        """The line as tables.

        Raises:
            ConfigError: the file cannot be used.
        """
        line = read_reference_line(self.file, self.roads)
        flat = constant(0.0)
        return line._replace(bank_rad=flat, grade=flat) if self.flat else line


def _from_map(part: str, otherwise: Any, alias: str | None = None) -> Any:
    """A field whose default is this part of the map of `opendrive`, or `otherwise` without one."""

    def default(read: dict[str, Any]) -> Any:
        source = read.get("opendrive")
        return otherwise if source is None else getattr(source.line, part)

    return Field(default_factory=default, validate_default=True, alias=alias)


def _both_sides(read: dict[str, Any]) -> Table:
    both = read.get("friction")
    return both if isinstance(both, Table) else constant(DRY_ASPHALT)


class Road(FileTable):
    """`[road]`: a reference line and the ground along it."""

    opendrive: OpenDrive | None = None
    """instead of curvature, bank, grade and length"""
    curvature_per_m: _Curvature = _from_map("curvature_per_m", constant(0.0))
    """positive to the left"""
    friction: _Friction | None = None
    """of both sides, without: 0.85; 1 is the road of the tyre test"""
    friction_left: _Friction = Field(default_factory=_both_sides)
    """under the left wheels, with friction_right in place of friction"""
    friction_right: _Friction = Field(default_factory=_both_sides)
    """under the right wheels"""
    bank_rad: _Bank = _from_map("bank_rad", constant(0.0), "bank_deg")
    """cross slope, positive if the left side is higher"""
    grade: _Grade = _from_map("grade", constant(0.0), "grade_percent")
    """rise over distance, positive uphill"""
    width_m: _Width | None = None
    """of the lane around the reference line, on which the reference has to stay"""
    length_m: _Length = _from_map("length_m", inf)
    """the drive is over where the road ends"""

    @model_validator(mode="before")
    @classmethod
    def _require_one_source(cls, raw: Any) -> Any:
        named = set(raw) if isinstance(raw, Mapping) else set()
        sides = named & {"friction_left", "friction_right"}
        if "friction" in named and sides:
            raise ValueError("friction: expected it, or friction_left and friction_right, not both")
        if len(sides) == 1:
            raise ValueError("friction_left: expected together with friction_right, found one")
        both = sorted(named & {"curvature_per_m", "bank_deg", "grade_percent", "length_m"})
        if "opendrive" in named and both:
            raise ValueError(f"{both[0]}: expected none beside opendrive, which contains it")
        return raw

    def at(self, s_m: float, tail_wind_mps: float = 0.0, cross_wind_mps: float = 0.0) -> RoadAt:
        """The ground under a car that is parallel to the road at arc length `s_m`."""
        return RoadAt(
            curvature_per_m=self.curvature_per_m.at(s_m),
            curvature_change_per_m2=self.curvature_per_m.slope_at(s_m),
            friction_left=self.friction_left.at(s_m),
            friction_right=self.friction_right.at(s_m),
            bank_rad=self.bank_rad.at(s_m),
            grade_rad=atan(self.grade.at(s_m)),
            wind_forward_mps=tail_wind_mps,
            wind_left_mps=cross_wind_mps,
        )

    @property
    def uniform_friction(self) -> float | None:
        """The friction, if it is the same everywhere and on both sides; None if it is not."""
        left, right = self.friction_left, self.friction_right
        is_uniform = left.is_constant and right.is_constant and left.at(0.0) == right.at(0.0)
        return left.at(0.0) if is_uniform else None
