"""Tables of a mapping file that describe signals: columns, units, signs, DBC, pose and car.

A mapping file assigns columns of a log, or signals of a CAN bus, to the signals of the contract.
`offline-import` reads it for logs, `rt-controller signals` for a car; both import these tables.
docs/own-data.md and docs/own-car.md explain every field.
"""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    FiniteFloat,
    NonNegativeFloat,
    PositiveFloat,
    ValidationInfo,
    create_model,
    model_validator,
)

from rt_controller.contract.car import CAR_VALUES, Car, car_of
from rt_controller.contract.limits import SteeringGeometry
from rt_controller.contract.signals import VEHICLE
from rt_controller.mapping.quantity import Quantity, quantity_of_name
from rt_controller.mapping.units import find_unit, near_units, si_unit_of_name
from rt_controller.settings_table import Settings

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


def _column_of(value: object) -> object:
    """The name of a signal, which may be in a table as other columns are."""
    return value["column"] if isinstance(value, dict) and value.keys() == {"column"} else value


def _known_kind(kind: str) -> str:
    if kind not in CHECKSUM_PARAMETERS:
        raise ValueError(f"expected one of {', '.join(CHECKSUM_PARAMETERS)}; {CHECKSUM_LIMIT}")
    return kind


def _in_folder(path: Path, info: ValidationInfo) -> Path:
    """The path, relative to the folder of the mapping file."""
    return info.context / path if info.context else path


Interval = Annotated[tuple[float, float], AfterValidator(_in_order)]
UnitName = Annotated[str, AfterValidator(_allowed)]
RelativePath = Annotated[Path, AfterValidator(_in_folder)]
PartName = Annotated[str, BeforeValidator(_column_of)]
Byte = Annotated[int, Field(ge=0, le=255, strict=True)]
CHECKSUM_LIMIT = (
    "checksums of 4 or 8 bits within one byte are known: CRC-8 (not reflected), sum and XOR over "
    "all other bits of the frame"
)
CHECKSUM_PARAMETERS = {
    "crc8": ("polynomial", "start", "final_xor", "data_id_first"),
    **dict.fromkeys(("crc8_0x1d", "crc8_0x2f"), ("data_id_first",)),
    **dict.fromkeys(("xor8", "xor4"), ("identifier", "length")),
    **dict.fromkeys(("sum8", "sum4"), ("identifier", "length", "complement")),
}
"""by kind, beside those of all"""
LONGEST_GAP_PERIODS = 3.5
"""longest gap in cycle times of the DBC or usual sampling periods: two lost samples are bridged"""


class Sampling(StrEnum):
    """What a signal does between two samples of the log."""

    SAMPLED = "sampled"
    """changes continuously; the data set has its value at each instant"""
    MEAN = "mean"
    """changes continuously; the data set has its mean over the following period"""
    HELD = "held"
    """keeps the last value, as commands do; the data set has its mean over the following period"""


class Clock(Settings):
    """When the rows of a table were recorded. MDF files and CAN logs have time stamps already."""

    column: str | None = None
    other_names: tuple[str, ...] = ()
    file: str | None = None
    """file of the times, beside that of the values; {name}: name of that file without its ending"""
    unit: Annotated[str, AfterValidator(_of_time)] | None = None
    period_s: PositiveFloat | None = None
    repeated: Literal["refuse", "skip"] = "refuse"
    starts_at_zero: bool = False
    """the times of every file count from its own first row, which all files recorded together"""

    @property
    def names(self) -> tuple[str, ...]:
        """Names that the column may have, the first one first; empty without a column."""
        return (self.column, *self.other_names) if self.column else ()


class ColumnMapping(Settings):
    """A column of the logs: SI value = sign * unit(factor * number + offset), `delay_s` earlier."""

    column: str
    other_names: tuple[str, ...] = ()
    file: str | None = None
    time: Clock | None = None
    unit: UnitName | None = None
    sign: Literal[1, -1] = 1
    factor: Annotated[FiniteFloat, AfterValidator(_not_zero)] = 1.0
    offset: FiniteFloat = 0.0
    fine: PartName | None = None
    """signal of the same CAN message, whose number is added to that of the column"""
    negative: PartName | None = None
    """signal of the same CAN message; if its raw value is not 0, the number is negative"""
    delay_s: FiniteFloat = 0.0
    """delay of the log: a sample stamped t was measured at t - delay_s"""
    sampling: Sampling = Sampling.SAMPLED
    missing: Literal["refuse", "skip"] = "refuse"
    longest_gap_s: PositiveFloat | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names that the column may have, the first one first."""
        return (self.column, *self.other_names)


class SignalMapping(ColumnMapping):
    """A column that becomes a signal of the data set."""

    quantity: Quantity | None = None
    keep: Interval | None = None
    """in SI; the drive is cut where the signal is outside"""
    plausible: Interval | None = None
    """in SI; a number outside is refused; None: the limits of the quantity"""
    steepest_per_s: PositiveFloat | None = None
    """in SI; the drive is cut where the signal changes faster; None: the limit of the quantity"""
    may_be_constant: bool = False


_required = {*SteeringGeometry._fields} - SteeringGeometry._field_defaults.keys()
_car_fields: dict[str, Any] = {
    name: (float, Field(... if name in _required else default, ge=low, le=high, strict=True))
    for name, (low, high, default, _) in CAR_VALUES.items()
}
_CarValues: Any = create_model("_CarValues", __base__=Settings, **_car_fields)


class CarData(_CarValues):  # type: ignore[misc]
    """The values of `contract/car.py`."""

    thresholds: dict[str, Any] = Field(default_factory=dict)
    """of the plausibility checks, by quantity; others keep theirs"""

    @model_validator(mode="after")
    def _require_known_thresholds(self) -> Self:
        car_of({"thresholds": self.thresholds})
        return self

    @property
    def car(self) -> Car:
        """The same as model bundle and gateway carry it."""
        return car_of(self.model_dump(include={*CAR_VALUES, "thresholds"}))


def is_angle(text: str | None) -> bool:
    """True if this is a unit of an angle."""
    unit = find_unit(text) if text else None
    return unit is not None and unit.si == "rad"


class RoadsMapping(Settings):
    """The roads that may be placed under a recording with poses."""

    curvatures_per_m: tuple[float, ...] = Field(
        default=(-4e-3, -2e-3, 0.0, 2e-3, 4e-3), min_length=1
    )
    ey_m: PositiveFloat = 2.0
    epsi_deg: PositiveFloat = 10.0


class PoseMapping(Settings):
    """Position and heading of the car, and the road to which the path states are relative."""

    x: ColumnMapping
    y: ColumnMapping
    yaw: ColumnMapping | None = None
    """None: only for logs, computed from the course"""
    ahead_m: FiniteFloat = 0.0
    """of the point that x and y are of, from the centre of gravity"""
    left_m: FiniteFloat = 0.0
    reference_line: RelativePath | None = None
    """CSV of x and y in m along the road, in the pose's frame; None: roads are placed under the
    drives as for simulated ones"""
    closed: bool = False
    smoothing_m: NonNegativeFloat = 0.02
    """root mean square distance between the smoothed line and its points"""
    farthest_m: PositiveFloat = 15.0
    roads: RoadsMapping = RoadsMapping()

    @property
    def is_geographic(self) -> bool:
        """True if x is a longitude and y a latitude, as angles in their units say."""
        return is_angle(self.x.unit) and is_angle(self.y.unit)

    @model_validator(mode="after")
    def _require_one_frame(self) -> Self:
        if self.x.unit and self.y.unit and is_angle(self.x.unit) != is_angle(self.y.unit):
            raise ValueError("expected x and y both in m, or longitude and latitude in deg")
        return self


class CanSettings(Settings):
    """How the CAN logs are decoded."""

    dbc: RelativePath
    channel: int | str | None = None


Value = SignalMapping | FiniteFloat
"""a signal of the bus, or a constant in SI"""


class Checksum(Settings):
    """Checksum of a message; see `mapping.checksum`."""

    signal: str
    kind: Annotated[str, AfterValidator(_known_kind)]
    """crc8_0x1d, crc8_0x2f: those of AUTOSAR; sum4, xor4: over nibbles"""
    data_id: tuple[Byte, ...] = ()
    """bytes that are not transmitted, after those of the frame"""
    data_ids: Annotated[tuple[Byte, ...], Field(min_length=16, max_length=16)] = ()
    """the same; the counter of the frame selects one"""
    data_id_first: bool = False
    """these bytes come before those of the frame"""
    polynomial: Byte | None = None
    """without the highest bit, which is always 1"""
    start: Byte = 0
    final_xor: Byte = 0
    identifier: bool = False
    """the bytes of the identifier are part of the sum"""
    length: bool = False
    """the number of bytes of the frame is part of the sum"""
    complement: Annotated[int, Field(ge=0, le=256)] | None = None
    """this number minus the sum is sent; None: the sum"""

    @property
    def bits(self) -> int:
        """Number of bits of the checksum."""
        return 4 if self.kind.endswith("4") else 8

    @model_validator(mode="after")
    def _require_fitting(self) -> Self:
        own = ("data_id", "data_ids", *CHECKSUM_PARAMETERS[self.kind])
        others = sorted(self.model_fields_set - {"signal", "kind", *own})
        if others:
            raise ValueError(
                f"expected parameters of {self.kind} ({', '.join(own)}), found {', '.join(others)}"
            )
        if self.kind == "crc8" and self.polynomial is None:
            raise ValueError("expected a polynomial for crc8, found none")
        return self


class MessageMapping(Settings):
    """Protection and period of a message, and what else a message with commands contains."""

    period_s: PositiveFloat | None = None
    """None: GenMsgCycleTime of the DBC; of a command at least a control period"""
    counter: str | None = None
    checksum: Checksum | None = None
    source: Literal["any"] | Byte | None = None
    """source address of a J1939 message, the lowest 8 bits of its identifier; None: as in the DBC,
    "any": the first that is heard is read, and that of the DBC is sent"""
    driving: dict[str, FiniteFloat] = Field(default_factory=dict)
    """other signals of a message with commands, while the controller drives or brakes the car"""
    standby: dict[str, FiniteFloat] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _require_counter(self) -> Self:
        if self.checksum and self.checksum.data_ids and self.counter is None:
            raise ValueError("expected a counter, which selects one of data_ids, found none")
        return self


class CommandsMapping(Settings):
    """Signals of the car that receive the inputs of the controller."""

    throttle: ColumnMapping
    brake_n: ColumnMapping
    steer_rad: ColumnMapping
    mode: ColumnMapping | None = None


class ReferenceMapping(Settings):
    """The path relative to the reference line, and the speed: signals of the car or constants."""

    v_mps: Value
    a_mps2: Value = 0.0
    c0_m: Value = 0.0
    c1: Value = 0.0
    c2_per_m: Value = 0.0
    c3_per_m2: Value = 0.0
    stop_mps2: PositiveFloat = 2.0
    """deceleration before the end of a reference line that is not closed"""


class SwitchMapping(SignalMapping):
    """A signal that is on or off."""

    on: Annotated[tuple[int, ...], Field(min_length=1)] | None = None
    """raw values that mean on; None: 1 of a number without unit, else SI values above 0.5"""
    off: Annotated[tuple[int, ...], Field(min_length=1)] | None = None
    """raw values that mean off, all others are not known; None: 0, 1 and the values that the
    DBC names, except those of `on` and those that stand for no value"""

    @model_validator(mode="after")
    def _require_on(self) -> Self:
        if self.fine or self.negative:
            raise ValueError("expected a switch of one signal, found fine or negative")
        both = set(self.on or ()) & set(self.off or ())
        if both or (self.off is not None and self.on is None):
            found = f"{sorted(both)} in both" if both else "no on"
            raise ValueError(f"off: expected other raw values than those of on, found {found}")
        return self


class MissionMapping(Settings):
    """Who starts and ends the drive."""

    engage: SwitchMapping | Literal[True]
    acknowledge: SwitchMapping | None = None
    car_brakes: SwitchMapping | None = None
    """on while the car does not follow the commands: its own watchdog, or its driver"""


class CarSignals(Settings):
    """Tables of a mapping file that describe a car; those for logs only are in `offline.logs`."""

    states: dict[str, SignalMapping]
    inputs: dict[str, SignalMapping] = Field(default_factory=dict)
    exogenous: dict[str, SignalMapping] = Field(default_factory=dict)
    pose: PoseMapping | None = None
    can: CanSettings | None = None
    car: CarData | None = None
    commands: CommandsMapping | None = None
    messages: dict[str, MessageMapping] = Field(default_factory=dict)
    reference: ReferenceMapping | None = None
    mission: MissionMapping | None = None

    @property
    def signals(self) -> dict[str, SignalMapping]:
        """States, inputs, exogenous signals, in this order, by name."""
        return {**self.states, **self.inputs, **self.exogenous}

    @property
    def pose_columns(self) -> tuple[ColumnMapping, ...]:
        """x, y and yaw, where it is mapped; empty without [pose]."""
        columns = (self.pose.x, self.pose.y, self.pose.yaw) if self.pose else ()
        return tuple(column for column in columns if column is not None)

    def quantity(self, name: str) -> Quantity:
        """What a signal measures."""
        return self.signals[name].quantity or quantity_of_name(name)

    def unit_mistakes(self) -> list[str]:
        """A sentence for each signal whose unit does not fit the unit in its name."""
        mistakes = []
        for name, signal in self.signals.items():
            expected, unit = si_unit_of_name(name), find_unit(signal.unit) if signal.unit else None
            if expected and unit and unit.si != expected:
                mistakes.append(
                    f"{name}: expected a unit that is converted to {expected}, as in the name, "
                    f"found {signal.unit!r}, which is converted to {unit.si}"
                )
        return mistakes


class DrivingMapping(CarSignals):
    """A mapping file as the gateway reads it; tables for logs are not looked at."""

    can: CanSettings
    commands: CommandsMapping
    reference: ReferenceMapping
    mission: MissionMapping
    period_s: Any = None
    time: Any = None
    csv: Any = None
    split: Any = None
    roles: Any = None
    checks: Any = None

    @model_validator(mode="after")
    def _require_consistency(self) -> Self:
        mistakes = self.unit_mistakes()
        required, inputs = ("vx_mps", "yaw_rate_radps"), VEHICLE.input_names
        states = tuple(name for name in VEHICLE.state_names if name != "ds_m")  # it is computed
        missing = [name for name in required if name not in self.states]
        if missing:
            mistakes.append(
                f"states: expected {', '.join(required)}, found none for "
                f"{', '.join(missing)}. Map a signal of the car"
            )
        for table, known in (("states", states), ("inputs", inputs)):
            unknown = [name for name in getattr(self, table) if name not in known]
            if unknown:
                mistakes.append(
                    f"{table}: expected names among {', '.join(known)}, found "
                    f"{', '.join(unknown)}. The controller drives with these only; leave the "
                    f"others out, or keep them in a file for offline-import"
                )
        if self.inputs and len(self.inputs) < len(inputs):
            mistakes.append(
                f"inputs: expected all of {', '.join(inputs)} or none, found "
                f"{', '.join(self.inputs)}. Map the others, or leave the table out"
            )
        has_line = self.pose is not None and self.pose.reference_line is not None
        place = [name for name in ("ey_m", "epsi_rad") if name in self.states]
        if not has_line and (len(place) < 2 or "curvature_per_m" not in self.exogenous):
            mistakes.append(
                "expected the place on the road: [pose] with a reference_line, or the states "
                "ey_m and epsi_rad with the exogenous signal curvature_per_m, found neither. A "
                "reference_line is a CSV of x and y in m along the road"
            )
        elif self.pose is not None and (self.pose.is_geographic or self.pose.yaw is None):
            mistakes.append(
                "pose: expected x and y in m in the frame of the reference_line, and yaw, found "
                "degrees or no yaw, which count for logs only. Map positions in m and the heading"
            )
        elif has_line and len(place) == 1:
            mistakes.append(
                f"states: expected ey_m and epsi_rad together or neither, found {place[0]} alone. "
                f"Leave it out: [pose] has a reference_line"
            )
        if mistakes:
            raise ValueError("\n".join(mistakes))
        return self
