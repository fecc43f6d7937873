"""`Road`: what the ground of a scenario is like, as tables over the arc length s."""

from collections.abc import Callable, Mapping
from functools import cached_property
from math import atan, degrees, inf, radians
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.limits import LEAST_FRICTION, MOST_FRICTION
from sim_bridge.frenet import CurvatureTable
from sim_bridge.plant.protocol import RoadAt
from sim_bridge.scenario.curvature import Circle, CourseOfBends, Spiral, Step
from sim_bridge.scenario.limits import (
    DRY_ASPHALT,
    LARGEST_CURVATURE_PER_M,
    STEEPEST_BANK_DEG,
    STEEPEST_PERCENT,
)
from sim_bridge.scenario.maps.opendrive import ReferenceLine, read_reference_line
from sim_bridge.scenario.table import Table, constant
from sim_bridge.scenario.values import Positive, form_of_table, require_within
from sim_bridge.toml_file import FileTable

_Curvature = Annotated[
    Table,
    form_of_table(
        -LARGEST_CURVATURE_PER_M,
        LARGEST_CURVATURE_PER_M,
        "1/m",
        kinds=(Circle, Spiral, Step, CourseOfBends),
    ),
]
_Friction = Annotated[Table, form_of_table(LEAST_FRICTION, MOST_FRICTION)]
_Bank = Annotated[
    Table, form_of_table(-STEEPEST_BANK_DEG, STEEPEST_BANK_DEG, "deg", factor=radians(1.0))
]
_Grade = Annotated[Table, form_of_table(-STEEPEST_PERCENT, STEEPEST_PERCENT, "%", factor=0.01)]
_Width = Annotated[Table, form_of_table(2.0, 100.0, "m")]


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
            ConfigError: the file cannot be used, or the line is out of the limits of a road.
        """
        line = read_reference_line(self.file, self.roads)
        if self.flat:
            line = line._replace(bank_rad=constant(0.0), grade=constant(0.0))
        for name, table, most, unit in (
            ("curvature_per_m", line.curvature_per_m, LARGEST_CURVATURE_PER_M, "1/m"),
            ("bank_deg", line.bank_rad.scaled(degrees(1.0)), STEEPEST_BANK_DEG, "deg"),
            ("grade_percent", line.grade.scaled(100.0), STEEPEST_PERCENT, "%"),
        ):
            try:
                require_within(table, -most, most, unit)
            except ValueError as error:
                raise ConfigError(
                    f"{self.file}: road.{name}: {error}. Choose another road; flat = true leaves "
                    f"out bank and grade."
                ) from error
        return line


def _of_map(part: str, otherwise: Any) -> Callable[[dict[str, Any]], Any]:
    """The default of a field: what an OpenDRIVE file has, or `otherwise` without one."""

    def default(read: dict[str, Any]) -> Any:
        source = read.get("opendrive")
        return otherwise if source is None else getattr(source.line, part)

    return default


def _of_both_sides(read: dict[str, Any]) -> Table:
    both = read.get("friction")
    return both if isinstance(both, Table) else constant(DRY_ASPHALT)


class Road(FileTable):
    """`[road]`: a reference line and the ground along it."""

    opendrive: OpenDrive | None = None
    """instead of curvature, bank, grade and length"""
    curvature_per_m: _Curvature = Field(default_factory=_of_map("curvature_per_m", constant(0.0)))
    """positive to the left"""
    friction: _Friction | None = None
    """default of both sides; 1 is the road of the tyre test"""
    friction_left: _Friction = Field(default_factory=_of_both_sides)
    """under the left wheels"""
    friction_right: _Friction = Field(default_factory=_of_both_sides)
    bank_rad: _Bank = Field(alias="bank_deg", default_factory=_of_map("bank_rad", constant(0.0)))
    """cross slope, positive if the left side is higher"""
    grade: _Grade = Field(alias="grade_percent", default_factory=_of_map("grade", constant(0.0)))
    """rise over distance, positive uphill"""
    width_m: _Width | None = None
    """of the lane around the reference line; None: not limited"""
    length_m: Positive = Field(default_factory=_of_map("length_m", inf))
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

    def curvature_ahead(self, s_m: float, reach_m: float, count: int) -> Array:
        """(count,) curvature in 1/m at equal distances from the car to `reach_m` ahead of it."""
        return self.curvature_per_m(s_m + np.linspace(0.0, reach_m, count))

    def frame(self) -> CurvatureTable:
        """The curvature as the compiled road frame reads it."""
        table = self.curvature_per_m
        return CurvatureTable(table.starts, table.coefficients)

    @property
    def uniform_friction(self) -> float | None:
        """The friction, if it is the same everywhere and on both sides; None if it is not."""
        left, right = self.friction_left, self.friction_right
        values = {left.at(0.0), right.at(0.0)}
        if left.is_constant and right.is_constant and len(values) == 1:
            return values.pop()
        return None
