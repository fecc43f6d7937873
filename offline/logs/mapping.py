"""The mapping file: which columns of the logs are which signals, and how the logs are read.

What a person writes, in TOML; docs/own-data.md explains every field.
"""

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import (
    Field,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
    field_validator,
    model_validator,
)

from offline.dataset import HELD_BACK
from offline.logs.column_mapping import ColumnMapping, Settings, SignalMapping
from offline.logs.quantity import Quantity, quantity_of_name
from offline.logs.units import parse_unit, unit_of_name
from offline.recording import PATH_STATES
from offline.roles import Roles
from rt_controller.contract.schema import VEHICLE
from rt_controller.contract.timing import PERIOD_S

CAR_STATES = VEHICLE.state_names[: -len(PATH_STATES)]
"""what must be known of the car before a road can be laid under it"""


class TimeMapping(Settings):
    """When the rows of a table were recorded. MF4 files and CAN logs bring stamps of their own."""

    column: str | None = None
    """None: rows are `period_s` apart"""
    unit: str = "s"
    """"iso8601" for dates"""
    period_s: PositiveFloat | None = None
    """what the logs claim; held against the column where there is one"""
    longest_gap_s: PositiveFloat | None = None
    """None: three and a half times the usual time between two samples"""
    skip_first_s: Annotated[float, Field(ge=0.0)] = 0.0
    """of every file: filters that settle"""

    @field_validator("unit")
    @classmethod
    def _of_time(cls, text: str) -> str:
        unit = parse_unit(text)
        if text != "iso8601" and (unit is None or unit.si != "s"):
            raise ValueError(f"expected a unit of time or 'iso8601', found {text!r}")
        return text


class RoadsMapping(Settings):
    """The roads that may be laid under a recording with poses."""

    curvatures_per_m: Annotated[tuple[float, ...], Field(min_length=1)] = (
        -4e-3,
        -2e-3,
        0.0,
        2e-3,
        4e-3,
    )
    ey_m: PositiveFloat = 2.0
    epsi_deg: PositiveFloat = 10.0


class PoseMapping(Settings):
    """Where the car is on a plane, and the road that its path states are told against."""

    x: ColumnMapping
    y: ColumnMapping
    yaw: ColumnMapping
    reference_line: Path | None = None
    """CSV of x and y in m along the road, in the pose's frame; None: roads are laid as for
    simulated drives"""
    closed: bool = False
    """the line's end meets its beginning"""
    smoothing_m: Annotated[float, Field(ge=0.0)] = 0.02
    """root mean square distance by which the smoothed line may miss its points"""
    farthest_m: PositiveFloat = 15.0
    """from the line; where the car is farther away, the drive is cut"""
    roads: RoadsMapping = RoadsMapping()


class CsvSettings(Settings):
    """How the CSV files are written."""

    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    """None: what the header suggests"""
    decimal: Literal[".", ","] | None = None
    header_line: PositiveInt = 1
    units_line: PositiveInt | None = None
    encoding: str = "utf-8-sig"


class CanSettings(Settings):
    """How the CAN logs are decoded."""

    dbc: Path
    channel: int | str | None = None
    """as python-can names it; None: all of them"""


class SplitSettings(Settings):
    """Which drives are held back. Named files come first, the rest is drawn."""

    by: Literal["episode", "file"] = "episode"
    seed: NonNegativeInt = 0
    share: Annotated[float, Field(gt=0.0, lt=0.5)] = HELD_BACK
    """of what is not named, for validation, and the same again for the test"""
    validation: tuple[str, ...] = ()
    """names of files or patterns of names"""
    test: tuple[str, ...] = ()
    longest_episode_s: PositiveFloat | None = None
    """longer stretches are cut into pieces of equal length"""


class RolesSettings(Settings):
    """See `offline.roles.Roles`."""

    centred: tuple[str, ...] | None = None
    """None: speeds, and progress"""
    odd: tuple[str, ...] | None = None
    """None: the car is not taken for symmetric"""
    past: tuple[str, ...] | None = None
    """None: all states but those of the path, and all inputs"""


class ChecksSettings(Settings):
    """What may pass although it looks wrong."""

    accept_units: bool = False
    """suspected mix-ups of units are reported and not refused"""


class Mapping(Settings):
    """How logs become a data set."""

    states: dict[str, SignalMapping]
    inputs: dict[str, SignalMapping]
    exogenous: dict[str, SignalMapping] = Field(default_factory=dict)
    period_s: PositiveFloat = PERIOD_S
    """of the data set"""
    time: TimeMapping = TimeMapping()
    pose: PoseMapping | None = None
    csv: CsvSettings = CsvSettings()
    can: CanSettings | None = None
    split: SplitSettings = SplitSettings()
    roles: RolesSettings = RolesSettings()
    checks: ChecksSettings = ChecksSettings()

    @property
    def signals(self) -> dict[str, SignalMapping]:
        """States, inputs, exogenous signals, in this order, by name."""
        return {**self.states, **self.inputs, **self.exogenous}

    @property
    def pose_columns(self) -> tuple[ColumnMapping, ...]:
        """X, Y, yaw; or none."""
        return (self.pose.x, self.pose.y, self.pose.yaw) if self.pose else ()

    @property
    def columns(self) -> tuple[str, ...]:
        """Every column that is read from the logs, time excepted."""
        wanted = [signal.column for signal in self.signals.values()]
        return tuple(dict.fromkeys([*wanted, *(each.column for each in self.pose_columns)]))

    @property
    def follows_line(self) -> bool:
        """Whether path states are told against a reference line."""
        return self.pose is not None and self.pose.reference_line is not None

    @property
    def state_names(self) -> tuple[str, ...]:
        """Of the data set: those of the logs, and with poses those of the path."""
        return (*self.states, *(PATH_STATES if self.pose else ()))

    @property
    def exogenous_names(self) -> tuple[str, ...]:
        return (*self.exogenous, *(VEHICLE.exogenous_names if self.pose else ()))

    def quantity(self, name: str) -> Quantity:
        """What a signal of the logs measures."""
        return self.signals[name].quantity or quantity_of_name(name)

    def name_of(self, quantity: Quantity) -> str | None:
        """The first signal that measures this."""
        return next((name for name in self.signals if self.quantity(name) is quantity), None)

    def resolve_roles(self) -> Roles:
        """The roles as written, with the defaults of those that are not; past in schema order."""
        chosen = self.roles
        speeds = [name for name in self.states if self.quantity(name) is Quantity.SPEED]
        centred = (*speeds, *(("ds_m",) if self.pose else ()))
        return Roles(
            centred=centred if chosen.centred is None else chosen.centred,
            odd=chosen.odd,
            past=tuple(
                name
                for name in (*self.states, *self.inputs)
                if chosen.past is None or name in chosen.past
            ),
        )

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if not self.states or not self.inputs:
            raise ValueError("expected at least one state and one input")
        groups = [*self.state_names, *self.inputs, *self.exogenous_names]
        twice = sorted({name for name in groups if groups.count(name) > 1})
        if twice:
            raise ValueError(f"expected each name once, found twice: {', '.join(twice)}")
        for name, signal in self.signals.items():
            _require_unit_of_name(name, signal.unit)
        for what, names in (
            ("centred", self.roles.centred),
            ("odd", self.roles.odd),
            ("past", self.roles.past),
        ):
            known = [*self.states, *self.inputs] if what == "past" else groups
            strangers = [name for name in names or () if name not in known]
            if strangers:
                raise ValueError(
                    f"roles.{what}: expected names among {', '.join(known)}, found "
                    f"{', '.join(strangers)}"
                )
        if self.pose and self.pose.reference_line is None:
            self._require_car()
        return self

    def _require_car(self) -> None:
        if tuple(self.states) != CAR_STATES or self.exogenous:
            raise ValueError(
                f"pose without a reference_line: expected the states {', '.join(CAR_STATES)} in "
                f"this order and no exogenous signal, so that roads can be laid under the drives, "
                f"found {', '.join(self.states)} and "
                f"{', '.join(self.exogenous) or 'no exogenous signal'}. Name a reference_line, or "
                f"leave [pose] out"
            )


def _require_unit_of_name(name: str, text: str | None) -> None:
    of_name = unit_of_name(name)
    unit = parse_unit(text) if text is not None else None
    if of_name and unit and unit.si != of_name:
        raise ValueError(
            f"{name}: expected a unit that becomes {of_name}, as the name says, found {text!r}, "
            f"which becomes {unit.si}"
        )
