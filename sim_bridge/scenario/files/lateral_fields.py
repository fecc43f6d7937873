"""The wanted lateral position in a scenario file: `reference.ey_m`."""

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, Tag, model_validator

from sim_bridge.scenario.cone_courses import ConeCourse, iso_3888_1, iso_3888_2, slalom
from sim_bridge.scenario.files.fields import (
    DISTANCE_TAG,
    NUMBER_TAG,
    TIME_TAG,
    NotNegative,
    OverDistance,
    OverTime,
    Positive,
    forms,
    kind_tag,
    require_within,
    table_of,
)
from sim_bridge.scenario.lanes import Body, Course
from sim_bridge.scenario.lateral import LateralTable, Move, Moves, Sine, overlaps
from sim_bridge.scenario.limits import LARGEST_EY_M
from sim_bridge.scenario.table import Interpolation, constant
from sim_bridge.toml_file import FileTable, Number, at_most

_Ey = Annotated[Number, Field(ge=-LARGEST_EY_M, le=LARGEST_EY_M)]
_Clearance = Annotated[Number, Field(ge=0.0, le=5.0)]


class MoveFields(FileTable):
    """One move."""

    start_m: Number
    """arc length at which the move begins"""
    length_m: Positive
    to_m: _Ey


class MovesFields(FileTable):
    """Minimum-jerk moves in a row."""

    kind: Literal["moves"]
    moves: Annotated[tuple[MoveFields, ...], at_most(10_000)]

    @model_validator(mode="after")
    def _require_order(self) -> Self:
        problems = overlaps([Move(m.start_m, m.length_m, m.to_m) for m in self.moves])
        if problems:
            raise ValueError("\n".join(problems))
        return self

    def course(self, body: Body) -> ConeCourse:
        """The moves, without cones."""
        moves = tuple(Move(m.start_m, m.length_m, m.to_m) for m in self.moves)
        return ConeCourse(Course(body), Moves(moves))


class SineFields(FileTable):
    """A sine, by its length over distance or its frequency over time."""

    kind: Literal["sine"]
    amplitude_m: _Ey
    wavelength_m: Positive | None = None
    frequency_hz: Annotated[Number, Field(gt=0.0, le=5.0)] | None = None
    start_s_m: NotNegative | None = None
    start_t_s: NotNegative | None = None
    periods: Annotated[Number, Field(ge=1.0)] | None = None
    """None: to the end of the drive"""
    fade_periods: Annotated[Number, Field(ge=0.0, le=100.0)] = 1.0
    """over which the amplitude grows"""

    @model_validator(mode="after")
    def _require_one_period(self) -> Self:
        if (self.wavelength_m is None) == (self.frequency_hz is None):
            raise ValueError("wavelength_m: expected it or frequency_hz, found both or none")
        if self.wavelength_m is None and self.start_s_m is not None:
            raise ValueError("start_s_m: expected start_t_s with frequency_hz, found start_s_m")
        if self.frequency_hz is None and self.start_t_s is not None:
            raise ValueError("start_t_s: expected start_s_m with wavelength_m, found start_t_s")
        if self.periods is not None and self.periods < 2.0 * self.fade_periods:
            raise ValueError(
                f"periods: expected at least twice fade_periods, {2.0 * self.fade_periods:g}, "
                f"found {self.periods:g}"
            )
        return self

    def course(self, body: Body) -> ConeCourse:
        """The sine, without cones."""
        periods = float("inf") if self.periods is None else self.periods
        if self.wavelength_m is not None:
            start, period, over_time = self.start_s_m or 0.0, self.wavelength_m, False
        else:
            start, period, over_time = self.start_t_s or 0.0, 1.0 / (self.frequency_hz or 1.0), True
        sine = Sine(self.amplitude_m, period, over_time, start, periods, self.fade_periods)
        return ConeCourse(Course(body), sine)


class SlalomFields(FileTable):
    """Cones in a row."""

    kind: Literal["slalom"]
    start_s_m: NotNegative
    spacing_m: Annotated[Number, Field(ge=5.0, le=200.0)]
    cones: Annotated[int, Field(ge=2, le=100, strict=True)]
    clearance_m: _Clearance = 0.3
    """between body and cones"""

    def course(self, body: Body) -> ConeCourse:
        """Cones and path."""
        return slalom(self.start_s_m, self.spacing_m, self.cones, body, self.clearance_m)


class Iso1Fields(FileTable):
    """ISO 3888-1."""

    kind: Literal["iso_3888_1"]
    start_s_m: NotNegative
    """beginning of the first lane"""
    clearance_m: _Clearance = 0.1
    """of the path to the edges of the lanes"""

    def course(self, body: Body) -> ConeCourse:
        """Lanes, cones and path."""
        return iso_3888_1(self.start_s_m, body, self.clearance_m)


class Iso2Fields(FileTable):
    """ISO 3888-2."""

    kind: Literal["iso_3888_2"]
    start_s_m: NotNegative
    clearance_m: _Clearance = 0.1

    def course(self, body: Body) -> ConeCourse:
        """Lanes, cones and path."""
        return iso_3888_2(self.start_s_m, body, self.clearance_m)


LateralForm = (
    float
    | OverDistance
    | OverTime
    | MovesFields
    | SineFields
    | SlalomFields
    | Iso1Fields
    | Iso2Fields
)


def _on_road(value: LateralForm) -> LateralForm:
    if isinstance(value, OverDistance | OverTime):
        if value.interpolation is Interpolation.STEP:
            raise ValueError("interpolation: expected linear, pchip or spline, found step")
        require_within(table_of(value), -LARGEST_EY_M, LARGEST_EY_M, " m")
    elif isinstance(value, int | float) and not abs(value) <= LARGEST_EY_M:
        raise ValueError(f"expected -{LARGEST_EY_M:g}..{LARGEST_EY_M:g} m, found {value:g}")
    return value


LateralValue = Annotated[
    Annotated[
        Annotated[Number, Tag(NUMBER_TAG)]
        | Annotated[OverDistance, Tag(DISTANCE_TAG)]
        | Annotated[OverTime, Tag(TIME_TAG)]
        | Annotated[MovesFields, Tag(kind_tag("moves"))]
        | Annotated[SineFields, Tag(kind_tag("sine"))]
        | Annotated[SlalomFields, Tag(kind_tag("slalom"))]
        | Annotated[Iso1Fields, Tag(kind_tag("iso_3888_1"))]
        | Annotated[Iso2Fields, Tag(kind_tag("iso_3888_2"))],
        forms(
            "a number, a table with value and s_m or t_s, or kind = moves, sine, slalom, "
            "iso_3888_1 or iso_3888_2 with its fields"
        ),
    ],
    AfterValidator(_on_road),
]


def wanted_lateral(value: LateralForm, body: Body) -> ConeCourse:
    """The lateral position of a field, with its cones and lanes.

    Raises:
        ValueError: the body does not fit into the lanes.
    """
    if isinstance(value, int | float):
        return ConeCourse(Course(body), LateralTable(constant(value)))
    if isinstance(value, OverDistance | OverTime):
        over_time = isinstance(value, OverTime)
        return ConeCourse(Course(body), LateralTable(value.table(), over_time))
    return value.course(body)
