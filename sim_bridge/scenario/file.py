"""A scenario file: a road, a wanted speed and path, and how the drive is judged."""

from itertools import pairwise
from math import inf, isnan
from operator import attrgetter
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, field_validator

from sim_bridge.faults.fault import Faults
from sim_bridge.plant.parts import NO_PAYLOAD, Payload
from sim_bridge.scenario.cone_courses import ConeCourse, IsoLaneChange, Slalom
from sim_bridge.scenario.lanes import Body, Course
from sim_bridge.scenario.lateral import NEAREST_KNOTS_M, LateralTable, Moves, Sine
from sim_bridge.scenario.limits import (
    FASTEST_KMH,
    KMH_PER_MPS,
    LARGEST_EY_M,
    LONGEST_S,
    STRONGEST_WIND_MPS,
)
from sim_bridge.scenario.metrics import HIGHER_IS_BETTER, Metrics
from sim_bridge.scenario.road import Road
from sim_bridge.scenario.scenario import Scenario, Start
from sim_bridge.scenario.speed import Stop, WantedSpeed, numbered
from sim_bridge.scenario.table import Interpolation, Table, constant
from sim_bridge.scenario.values import (
    Form,
    OverDistance,
    OverTime,
    Positive,
    form_of_table,
    require_within,
)
from sim_bridge.toml_file import FileTable, Number, at_most

Path = LateralTable | Moves | Sine | Slalom | IsoLaneChange


def _on_road(found: Any) -> Path:
    """The path of a file: its table, or its kind."""
    if isinstance(found, Path):
        return found
    if isinstance(found, OverDistance | OverTime):
        if found.interpolation is Interpolation.STEP:
            raise ValueError("interpolation: expected linear, pchip or spline, found step")
        nearest_m = min((b - a for a, b in pairwise(found.x)), default=inf)
        if isinstance(found, OverDistance) and nearest_m < NEAREST_KNOTS_M:
            raise ValueError(
                f"s_m: expected knots {NEAREST_KNOTS_M:g} m apart or more, found {nearest_m:.3g} m"
            )
        table = found.table()
    else:
        table = constant(found)
    require_within(table, -LARGEST_EY_M, LARGEST_EY_M, "m")
    return LateralTable(table, isinstance(found, OverTime))


class Reference(FileTable):
    """`[reference]`: what the car is asked for."""

    speed_kmh: WantedSpeed
    ey_m: Annotated[
        Path, Form((OverDistance, OverTime), _on_road, (Moves, Sine, Slalom, IsoLaneChange))
    ] = LateralTable(constant(0.0))


class LimitedPayload(FileTable):
    """`[payload]`: a load in the car, within the limits of a file."""

    mass_kg: Annotated[Number, Field(ge=0.0, le=1000.0)]
    ahead_m: Annotated[Number, Field(ge=-2.0, le=2.0)] = NO_PAYLOAD.ahead_m
    height_m: Annotated[Number, Field(ge=0.0, le=3.0)] = NO_PAYLOAD.height_m


def _known_metric(name: str) -> str:
    if name not in Metrics._fields:
        raise ValueError(f"expected one of {', '.join(Metrics._fields)}, found {name!r}")
    return name


_MetricName = Annotated[str, AfterValidator(_known_metric)]
_Wind = Annotated[
    Table, form_of_table(-STRONGEST_WIND_MPS, STRONGEST_WIND_MPS, "m/s", over=OverTime)
]


class ScenarioFile(FileTable):
    """A whole file of format 2."""

    format: Literal[2]
    name: Annotated[str, Field(min_length=1)]
    duration_s: Annotated[Number, Field(gt=0.0, le=LONGEST_S)]
    distance_m: Positive = inf
    initial: Start = Start()
    road: Road = Field(default_factory=Road)
    reference: Reference
    stops: Annotated[tuple[Stop, ...], at_most(1000), AfterValidator(numbered)] = ()
    cross_wind_mps: _Wind = constant(0.0)
    tail_wind_mps: _Wind = constant(0.0)
    payload: LimitedPayload | None = None
    body: Body = Body()
    faults: Faults = ()
    metrics: tuple[_MetricName, ...] = ()
    limits: dict[_MetricName, Number] = Field(default_factory=dict)

    @field_validator("limits")
    @classmethod
    def _reachable(cls, limits: dict[str, float]) -> dict[str, float]:
        problems = [
            f"{name}: expected at least 0, found {value:g}"
            for name, value in limits.items()
            if value < 0.0 and name not in HIGHER_IS_BETTER
        ]
        if problems:
            raise ValueError("\n".join(problems))
        return limits

    def scenario(self) -> Scenario:
        """The drive.

        Raises:
            ValueError: fields do not fit each other; the message names them.
        """
        road, start = self.road, self.initial
        end_m = min(road.length_m, start.s_m + self.distance_m)
        fastest_m = start.s_m + self.duration_s * FASTEST_KMH / KMH_PER_MPS
        speed = self.reference.speed_kmh.on_road(road.curvature_per_m, min(end_m, fastest_m))
        path = self.reference.ey_m
        try:
            driven = (
                path.driven_by(self.body)
                if isinstance(path, Slalom | IsoLaneChange)
                else ConeCourse(Course(self.body), path)
            )
        except ValueError as error:
            raise ValueError(f"reference.ey_m.{error}") from error
        if isnan(start.speed_mps):
            start = start.model_copy(update={"speed_mps": speed.at(start.s_m, 0.0)})
        return Scenario(
            name=self.name,
            duration_s=self.duration_s,
            start=start,
            road=road,
            speed=speed,
            lateral=driven.lateral,
            stops=tuple(sorted((*speed.stops, *self.stops), key=attrgetter("at_s_m", "entry"))),
            cross_wind_mps=self.cross_wind_mps,
            tail_wind_mps=self.tail_wind_mps,
            distance_m=self.distance_m,
            payload=NO_PAYLOAD if self.payload is None else Payload(**dict(self.payload)),
            course=driven.course,
            faults=self.faults,
            metrics=self.metrics,
            limits=self.limits,
        )
