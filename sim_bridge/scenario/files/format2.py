"""Scenario files of format 2: a road, a wanted speed and path, and how the drive is judged."""

from math import inf, radians
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, field_validator

from sim_bridge.faults.fault import Faults
from sim_bridge.plant.parts import Payload
from sim_bridge.scenario.files.fields import (
    NotNegative,
    Positive,
    TimeValue,
    require_within,
    table_of,
)
from sim_bridge.scenario.files.lateral_fields import LateralValue, wanted_lateral
from sim_bridge.scenario.files.road_fields import RoadFields
from sim_bridge.scenario.files.speed_fields import SpeedValue, StopFields, wanted_speed
from sim_bridge.scenario.lanes import Body
from sim_bridge.scenario.limits import (
    FASTEST_KMH,
    KMH_PER_MPS,
    LARGEST_START_EPSI_DEG,
    LARGEST_START_EY_M,
    LONGEST_S,
    STRONGEST_WIND_MPS,
)
from sim_bridge.scenario.metrics import HIGHER_IS_BETTER, Limit, Metrics
from sim_bridge.scenario.scenario import Scenario, Start
from sim_bridge.toml_file import FileTable, Number, at_most


class InitialFields(FileTable):
    """`[initial]`: the car when the drive begins."""

    speed_kmh: Annotated[Number, Field(ge=0.0, le=FASTEST_KMH)] | None = None
    """None: the wanted speed"""
    s_m: NotNegative = 0.0
    ey_m: Annotated[Number, Field(ge=-LARGEST_START_EY_M, le=LARGEST_START_EY_M)] = 0.0
    epsi_deg: Annotated[Number, Field(ge=-LARGEST_START_EPSI_DEG, le=LARGEST_START_EPSI_DEG)] = 0.0


class ReferenceFields(FileTable):
    """`[reference]`: what the car is asked for."""

    speed_kmh: SpeedValue
    ey_m: LateralValue = 0.0


class BodyFields(FileTable):
    """`[body]`: outline of the car, for lanes and cones."""

    width_m: Annotated[Number, Field(ge=0.5, le=4.0)] = Body().width_m
    front_m: Annotated[Number, Field(ge=0.3, le=10.0)] = Body().front_m
    rear_m: Annotated[Number, Field(ge=0.3, le=10.0)] = Body().rear_m


class PayloadFields(FileTable):
    """`[payload]`: a load in the car."""

    mass_kg: Annotated[Number, Field(ge=0.0, le=1000.0)]
    ahead_m: Annotated[Number, Field(ge=-2.0, le=2.0)] = Payload().ahead_m
    height_m: Annotated[Number, Field(ge=0.0, le=3.0)] = Payload().height_m


def _known_metric(name: str) -> str:
    if name not in Metrics._fields:
        raise ValueError(f"expected one of {', '.join(Metrics._fields)}, found {name!r}")
    return name


def _real_wind(value: TimeValue) -> TimeValue:
    require_within(table_of(value), -STRONGEST_WIND_MPS, STRONGEST_WIND_MPS, " m/s")
    return value


_MetricName = Annotated[str, AfterValidator(_known_metric)]


class Format2(FileTable):
    """A whole file."""

    format: Literal[2]
    name: Annotated[str, Field(min_length=1)]
    duration_s: Annotated[Number, Field(gt=0.0, le=LONGEST_S)]
    distance_m: Positive | None = None
    initial: InitialFields = InitialFields()
    road: RoadFields = RoadFields()
    reference: ReferenceFields
    stops: Annotated[tuple[StopFields, ...], at_most(1000)] = ()
    cross_wind_mps: Annotated[TimeValue, AfterValidator(_real_wind)] = 0.0
    tail_wind_mps: Annotated[TimeValue, AfterValidator(_real_wind)] = 0.0
    payload: PayloadFields | None = None
    body: BodyFields = BodyFields()
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

    def scenario(self, folder: Path) -> Scenario:
        """The scenario; `folder` is that of the file.

        Raises:
            ConfigError: a file that it names cannot be used.
            ValueError: fields do not fit each other; the message names them.
        """
        road = self.road.road(folder)
        distance_m = inf if self.distance_m is None else self.distance_m
        start_m = self.initial.s_m
        end_m = min(road.length_m, start_m + distance_m)
        fastest_m = start_m + self.duration_s * FASTEST_KMH / KMH_PER_MPS
        wanted = wanted_speed(self.reference.speed_kmh, road.curvature_per_m, min(end_m, fastest_m))
        named = (fields.stop._replace(entry=f"stops[{k}]") for k, fields in enumerate(self.stops))
        stops = tuple(sorted((*wanted.stops, *named), key=attrgetter("at_s_m", "entry")))
        body = Body(self.body.width_m, self.body.front_m, self.body.rear_m)
        try:
            cones = wanted_lateral(self.reference.ey_m, body)
        except ValueError as error:
            raise ValueError(f"reference.ey_m.{error}") from error
        speed_mps = wanted.profile.at(start_m, 0.0)
        if self.initial.speed_kmh is not None:
            speed_mps = self.initial.speed_kmh / KMH_PER_MPS
        return Scenario(
            name=self.name,
            duration_s=self.duration_s,
            start=Start(speed_mps, start_m, self.initial.ey_m, radians(self.initial.epsi_deg)),
            road=road,
            speed=wanted.profile,
            lateral=cones.lateral,
            stops=stops,
            cross_wind_mps=table_of(self.cross_wind_mps),
            tail_wind_mps=table_of(self.tail_wind_mps),
            distance_m=distance_m,
            payload=Payload() if self.payload is None else Payload(**self.payload.model_dump()),
            course=cones.course,
            faults=self.faults,
            metrics=self.metrics,
            limits=tuple(Limit(name, value) for name, value in self.limits.items()),
        )
