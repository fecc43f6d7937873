"""Tables of a mapping file that describe signals: columns, units, signs, DBC, pose and car.

A mapping file assigns columns of a log, or signals of a CAN bus, to the signals of the contract.
`offline-import` reads it for logs, `rt-controller signals` for a car; both import these tables.
docs/own-data.md and docs/own-car.md explain every field.
"""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    NonNegativeFloat,
    PositiveFloat,
    ValidationInfo,
)

from rt_controller.contract.limits import INPUT_LIMITS, LARGEST, SMALLEST, SteeringGeometry
from rt_controller.mapping.quantity import Quantity
from rt_controller.mapping.units import find_unit, near_units

DATE, TIME_OF_DAY = TEXT_TIMES = ("iso8601", "hh:mm:ss")
"""times that are written as text"""


def _in_order(interval: tuple[float, float]) -> tuple[float, float]:
    if not interval[0] < interval[1]:
        raise ValueError("expected [low, high]")
    return interval


def _allowed(unit: str) -> str:
    if find_unit(unit) is None:
        raise ValueError(f"expected an allowed unit ({near_units(unit)})")
    return unit


def _not_zero(factor: float) -> float:
    if factor == 0.0:
        raise ValueError("expected a factor other than zero")
    return factor


def _of_time(unit: str) -> str:
    found = find_unit(unit)
    if unit not in TEXT_TIMES and (found is None or found.si != "s"):
        raise ValueError(f"expected a unit of time, or {' or '.join(map(repr, TEXT_TIMES))}")
    return unit


def _in_folder(path: Path, info: ValidationInfo) -> Path:
    """The path, relative to the folder of the mapping file."""
    return info.context / path if info.context else path


Interval = Annotated[tuple[float, float], AfterValidator(_in_order)]
UnitName = Annotated[str, AfterValidator(_allowed)]
RelativePath = Annotated[Path, AfterValidator(_in_folder)]


class MappingTable(BaseModel):
    """A table of the file; unknown fields are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Sampling(StrEnum):
    """What a signal does between two samples of the log."""

    SAMPLED = "sampled"
    """changes continuously; the data set has its value at each instant"""
    MEAN = "mean"
    """changes continuously; the data set has its mean over the following period"""
    HELD = "held"
    """keeps the last value, as commands do; the data set has its mean over the following period"""


class Clock(MappingTable):
    """When the rows of a table were recorded. MDF files and CAN logs have time stamps already."""

    column: str | None = None
    other_names: tuple[str, ...] = ()
    """of the column, in logs that have none of the first name"""
    file: str | None = None
    """file of the times, beside that of the values; {name}: name of that file without its ending"""
    unit: Annotated[str, AfterValidator(_of_time)] | None = None
    """or one of `TEXT_TIMES`; None: the one behind the column's name in the file, or s"""
    period_s: PositiveFloat | None = None
    """time between two rows; compared with the column if there is one"""
    repeated: Literal["refuse", "skip"] = "refuse"
    """rows with the time of the row before"""
    starts_at_zero: bool = False
    """the times of every file count from its own first row, which all files recorded together"""

    @property
    def names(self) -> tuple[str, ...]:
        """Names that the column may have, the first one first; empty without a column."""
        return (self.column, *self.other_names) if self.column else ()


class ColumnMapping(MappingTable):
    """A column of the logs: SI value = sign * unit(factor * number + offset), `delay_s` earlier."""

    column: str
    other_names: tuple[str, ...] = ()
    """of the column, in logs that have none of the first name"""
    file: str | None = None
    """file of a drive that has one for each signal; None: every drive is one file"""
    time: Clock | None = None
    """clock of this column alone; None: that of [time]"""
    unit: UnitName | None = None
    """None: the unit that the log itself gives"""
    sign: Literal[1, -1] = 1
    factor: Annotated[FiniteFloat, AfterValidator(_not_zero)] = 1.0
    offset: FiniteFloat = 0.0
    delay_s: FiniteFloat = 0.0
    """delay of the log: a sample stamped t was measured at t - delay_s"""
    sampling: Sampling = Sampling.SAMPLED
    missing: Literal["refuse", "skip"] = "refuse"
    longest_gap_s: PositiveFloat | None = None
    """between two samples; None: that of [time]"""

    @property
    def names(self) -> tuple[str, ...]:
        """Names that the column may have, the first one first."""
        return (self.column, *self.other_names)


class SignalMapping(ColumnMapping):
    """A column that becomes a signal of the data set."""

    quantity: Quantity | None = None
    """None: derived from the signal's name"""
    keep: Interval | None = None
    """in SI; the drive is cut where the signal is outside"""
    plausible: Interval | None = None
    """in SI; a number outside is refused; None: the limits of the quantity"""
    steepest_per_s: PositiveFloat | None = None
    """in SI; the drive is cut where the signal changes faster; None: the limit of the quantity"""
    may_be_constant: bool = False


class CarData(MappingTable):
    """The car of the logs: the controller steers with it below the speeds of the model."""

    wheelbase_m: Annotated[float, Field(ge=SMALLEST.wheelbase_m, le=LARGEST.wheelbase_m)]
    rear_axle_m: Annotated[float, Field(ge=SMALLEST.rear_axle_m, le=LARGEST.rear_axle_m)]
    """centre of gravity to rear axle"""
    steering_ratio: Annotated[float, Field(ge=SMALLEST.steering_ratio, le=LARGEST.steering_ratio)]
    """angle of the steering wheel over the angle of the front wheels"""
    lock_rad: Annotated[float, Field(ge=SMALLEST.lock_rad, le=LARGEST.lock_rad)] = (
        INPUT_LIMITS.upper.steer_rad
    )
    """largest angle of the steering wheel; the faster the car, the less of it is used"""
    rear_slip_s2_per_m: Annotated[float, Field(ge=1e-4, le=0.05)] | None = None
    """side-slip angle of the rear axle per lateral acceleration, in rad; rt-controller estimates a
    lateral speed that is not measured with it; None: identified from the model"""
    yaw_inertia_m: Annotated[float, Field(ge=0.0, le=10.0)] | None = None
    """moment of inertia about z over mass and distance from centre of gravity to front axle; goes
    with rear_slip_s2_per_m"""

    @property
    def geometry(self) -> SteeringGeometry:
        """The same numbers as the model bundle carries them."""
        return SteeringGeometry(
            self.wheelbase_m, self.rear_axle_m, self.steering_ratio, self.lock_rad
        )


class RoadsMapping(MappingTable):
    """The roads that may be placed under a recording with poses."""

    curvatures_per_m: Annotated[tuple[float, ...], Field(min_length=1)] = (
        *(-4e-3, -2e-3, 0.0, 2e-3, 4e-3),
    )
    ey_m: PositiveFloat = 2.0
    epsi_deg: PositiveFloat = 10.0


class PoseMapping(MappingTable):
    """Position and heading of the car, and the road to which the path states are relative."""

    x: ColumnMapping
    y: ColumnMapping
    yaw: ColumnMapping
    reference_line: RelativePath | None = None
    """CSV of x and y in m along the road, in the pose's frame; None: roads are placed under the
    drives as for simulated ones"""
    closed: bool = False
    smoothing_m: NonNegativeFloat = 0.02
    """root mean square distance between the smoothed line and its points"""
    farthest_m: PositiveFloat = 15.0
    roads: RoadsMapping = RoadsMapping()


class CanSettings(MappingTable):
    """How the CAN logs are decoded."""

    dbc: RelativePath
    channel: int | str | None = None
    """as python-can names it; None: all channels"""
