"""The wanted speed in a scenario file: `reference.speed_kmh` and `[[stops]]`."""

from collections.abc import Sequence
from itertools import pairwise
from math import inf
from typing import Annotated, Literal, NamedTuple, Self

from pydantic import AfterValidator, Field, Tag, field_validator, model_validator

from sim_bridge.scenario.curve_speed import Comfort, curve_speed
from sim_bridge.scenario.files.fields import (
    DISTANCE_TAG,
    NUMBER_TAG,
    TIME_TAG,
    Knots,
    NotNegative,
    OverTime,
    Positive,
    forms,
    kind_tag,
    require_knots,
    require_within,
)
from sim_bridge.scenario.limits import FASTEST_KMH, KMH_PER_MPS, SLOWEST_KMH
from sim_bridge.scenario.speed import (
    SpeedProfile,
    Stop,
    constant_speed,
    speed_over_distance,
)
from sim_bridge.scenario.table import Interpolation, Table, constant
from sim_bridge.toml_file import FileTable, Number

_Cruise = Annotated[Number, Field(ge=SLOWEST_KMH, le=FASTEST_KMH)]
_Acceleration = Annotated[Number, Field(ge=0.1, le=12.0)]


class StopFields(FileTable):
    """`[[stops]]`: brake to rest at a place, hold, drive on."""

    at_s_m: NotNegative
    hold_s: NotNegative | None = None
    """None: to the end of the drive"""
    deceleration_mps2: _Acceleration = 2.5
    acceleration_mps2: _Acceleration = 2.0

    @property
    def stop(self) -> Stop:
        """The stop."""
        hold_s = inf if self.hold_s is None else self.hold_s
        return Stop(self.at_s_m, hold_s, self.deceleration_mps2, self.acceleration_mps2)


class SpeedOverDistance(FileTable):
    """Speed in km/h over the arc length; constant acceleration between the knots."""

    s_m: Knots
    value: Knots
    interpolation: None = None
    """of every other table; a speed over s_m has none"""

    @field_validator("interpolation", mode="before")
    @classmethod
    def _refuse(cls, found: object) -> None:
        raise ValueError(
            "expected none for a speed over s_m, whose acceleration is constant between the "
            f"knots, found {found!r}"
        )

    @model_validator(mode="after")
    def _require_knots(self) -> Self:
        require_knots("s_m", self.s_m, self.value)
        stands = [v == 0.0 for v in self.value]
        if any(a and not b for a, b in pairwise(stands)):
            raise ValueError(
                "value: expected a speed above 0 after a speed of 0, or 0 up to the end; a speed "
                "over s_m cannot leave a standstill, found one. Use [[stops]] with hold_s, or t_s"
            )
        return self


class CurveSpeed(FileTable):
    """The speed that curvature, acceleration and deceleration allow."""

    kind: Literal["curve_speed"]
    max_kmh: _Cruise
    lateral_mps2: _Acceleration = Comfort().lateral_mps2
    acceleration_mps2: _Acceleration = Comfort().acceleration_mps2
    deceleration_mps2: _Acceleration = Comfort().deceleration_mps2


class StopAndGo(FileTable):
    """Equal distances between stops."""

    kind: Literal["stop_and_go"]
    cruise_kmh: _Cruise
    first_stop_s_m: Positive
    spacing_m: Positive
    count: Annotated[int, Field(ge=1, le=1000, strict=True)]
    hold_s: NotNegative = 3.0
    deceleration_mps2: _Acceleration = 2.5
    acceleration_mps2: _Acceleration = 2.0

    @property
    def stops(self) -> list[Stop]:
        """Its stops."""
        return [
            Stop(
                self.first_stop_s_m + k * self.spacing_m,
                self.hold_s,
                self.deceleration_mps2,
                self.acceleration_mps2,
            )
            for k in range(self.count)
        ]


Speed = float | SpeedOverDistance | OverTime | CurveSpeed | StopAndGo


def _real_speed(value: Speed) -> Speed:
    if isinstance(value, SpeedOverDistance):
        if not all(0.0 <= v <= FASTEST_KMH for v in value.value):
            raise ValueError(f"expected 0..{FASTEST_KMH:g} km/h, found {_outside(value.value):g}")
    elif isinstance(value, OverTime):
        if value.interpolation not in (Interpolation.LINEAR, Interpolation.PCHIP):
            raise ValueError(
                f"interpolation: expected linear or pchip for a speed over time, found "
                f"{value.interpolation.value}"
            )
        require_within(value.table(), 0.0, FASTEST_KMH, " km/h")
    elif isinstance(value, int | float):
        if not 0.0 <= value <= FASTEST_KMH:
            raise ValueError(f"expected 0..{FASTEST_KMH:g} km/h, found {value:g}")
        if 0.0 < value < SLOWEST_KMH:
            raise ValueError(f"expected 0 or at least {SLOWEST_KMH:g} km/h, found {value:g}")
    return value


def _outside(values: Sequence[float]) -> float:
    return next(v for v in values if not 0.0 <= v <= FASTEST_KMH)


SpeedValue = Annotated[
    Annotated[
        Annotated[Number, Tag(NUMBER_TAG)]
        | Annotated[SpeedOverDistance, Tag(DISTANCE_TAG)]
        | Annotated[OverTime, Tag(TIME_TAG)]
        | Annotated[CurveSpeed, Tag(kind_tag("curve_speed"))]
        | Annotated[StopAndGo, Tag(kind_tag("stop_and_go"))],
        forms(
            "a number, a table with value and s_m or t_s, or kind = curve_speed or stop_and_go "
            "with its fields"
        ),
    ],
    AfterValidator(_real_speed),
]


class WantedSpeed(NamedTuple):
    """A profile and the stops that come with it."""

    profile: SpeedProfile
    stops: tuple[Stop, ...] = ()


def wanted_speed(value: Speed, curvature: Table, end_m: float) -> WantedSpeed:
    """The profile of a field.

    Args:
        value: as it was read.
        curvature: of the road in 1/m.
        end_m: arc length up to which a speed for curves is computed.
    """
    if isinstance(value, SpeedOverDistance):
        mps = [v / KMH_PER_MPS for v in value.value]
        return WantedSpeed(speed_over_distance(value.s_m, mps), _stop_at_end(value.s_m, mps))
    if isinstance(value, OverTime):
        return WantedSpeed(SpeedProfile(value.table().scaled(1.0 / KMH_PER_MPS)))
    if isinstance(value, CurveSpeed):
        fastest_mps = constant(value.max_kmh / KMH_PER_MPS)
        comfort = Comfort(value.lateral_mps2, value.acceleration_mps2, value.deceleration_mps2)
        return WantedSpeed(curve_speed(curvature, fastest_mps, end_m, comfort))
    if isinstance(value, StopAndGo):
        return WantedSpeed(constant_speed(value.cruise_kmh / KMH_PER_MPS), tuple(value.stops))
    return WantedSpeed(constant_speed(value / KMH_PER_MPS))


def _stop_at_end(s_m: Sequence[float], mps: Sequence[float]) -> tuple[Stop, ...]:
    """The stop of a profile that ends with a speed of 0."""
    if mps[-1] > 0.0 or mps[0] == 0.0:
        return ()
    k = mps.index(0.0)
    # With the steepest way down from any knot the stop never lies below the profile before it.
    steepest = max(v * v / (2.0 * (s_m[k] - s)) for s, v in zip(s_m[:k], mps[:k], strict=True))
    return (Stop(s_m[k], deceleration_mps2=steepest),)
