"""The mapping file in TOML: which columns of the logs are which signals, and how they are read.

Tables of the signals, and those that the controller shares, are in `rt_controller.mapping.tables`;
docs/own-data.md explains every field.
"""

from collections import Counter
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import (
    Field,
    NonNegativeFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
    TypeAdapter,
    model_validator,
)

from offline.data.manifest import HELD_BACK
from offline.data.recording import PATH_STATES
from offline.data.signals import Roles
from rt_controller.contract.signals import VEHICLE
from rt_controller.contract.timing import PERIOD_S
from rt_controller.mapping.quantity import Quantity, quantity_of_name
from rt_controller.mapping.slots import Slot, slots_of
from rt_controller.mapping.tables import (
    CarSignals,
    Clock,
    ColumnMapping,
    PoseMapping,
    SignalMapping,
)
from rt_controller.mapping.toml_file import parse, read_own
from rt_controller.settings_table import Settings


class TimeMapping(Clock):
    """The clock of all columns that have none of their own, and how gaps are treated."""

    longest_gap_s: PositiveFloat | None = None
    """None: 3.5 times the usual time between two samples"""
    skip_first_s: NonNegativeFloat = 0.0


class CsvSettings(Settings):
    """Format of the CSV files."""

    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    decimal: Literal[".", ","] | None = None
    header_line: NonNegativeInt | None = None
    """None: the first line, without comments; 0: no header, the columns are named 1, 2, ..."""
    units_line: PositiveInt | None = None
    encoding: str = "utf-8-sig"


class SplitSettings(Settings):
    """Which drives are held back. Files with a pattern here come first, the rest is drawn."""

    by: Literal["episode", "file"] = "episode"
    seed: NonNegativeInt = 0
    share: Annotated[float, Field(gt=0.0, lt=0.5)] = HELD_BACK
    """of the drawn ones: this share for validation, and the same for the test"""
    validation: tuple[str, ...] = ()
    test: tuple[str, ...] = ()
    longest_episode_s: PositiveFloat | None = None


class RolesSettings(Settings):
    """See `offline.data.signals.Roles`, and `LogMapping.resolve_roles` for what None stands for."""

    centred: tuple[str, ...] | None = None
    odd: tuple[str, ...] | None = None
    past: tuple[str, ...] | None = None


class ChecksSettings(Settings):
    """Which checks only report, and what else there is to compare with."""

    accept_units: bool = False
    accept_repeated: bool = False
    """stretches that two logs have in common"""
    signals: dict[str, SignalMapping] = Field(default_factory=dict)
    """second measurements of the motion; no part of the data set"""


GEOGRAPHIC_WITH_LINE = (
    "expected x and y in the frame of the reference_line, found degrees, which become m from the "
    "first point of each log. Give positions in m, or leave the reference_line out"
)

CAR_STATES = VEHICLE.state_names[: -len(PATH_STATES)]
"""states that a log must have so that a road can be placed under the drive"""


class LogMapping(CarSignals):
    """The whole file: how logs become a data set."""

    period_s: PositiveFloat = PERIOD_S
    """of the data set"""
    lateral_speed: Literal["estimated", "none"] = "estimated"
    """if it is not in the logs"""
    time: TimeMapping = TimeMapping()
    csv: CsvSettings = CsvSettings()
    split: SplitSettings = SplitSettings()
    roles: RolesSettings = RolesSettings()
    checks: ChecksSettings = ChecksSettings()

    @property
    def every_column(self) -> tuple[ColumnMapping, ...]:
        """Every column that is read from the logs, except those of time."""
        return (*self.read_signals.values(), *self.pose_columns)

    @property
    def slots(self) -> tuple[Slot, ...]:
        """The same with what makes a number a measurement; positions may be in deg in the log."""
        names = zip(("x", "y", "yaw"), self.pose_columns, strict=False)
        x_y_yaw = slots_of("pose", names)
        poses = (each if each.name == "pose.yaw" else each._replace(si="") for each in x_y_yaw)
        return (*slots_of("signals", self.read_signals.items()), *poses)

    @property
    def read_signals(self) -> dict[str, SignalMapping]:
        """Signals of the data set, then those that are only compared with them."""
        return {**self.signals, **self.checks.signals}

    @property
    def files(self) -> tuple[str, ...]:
        """Patterns of the files of one drive; empty if each drive is one file."""
        return tuple(dict.fromkeys(each.file for each in self.every_column if each.file))

    @property
    def places_roads(self) -> bool:
        """True if there are poses, also estimated ones, and roads are placed under the drives."""
        if self.pose is not None:
            return self.pose.reference_line is None
        is_of_controller = self.car_states == CAR_STATES and not self.exogenous
        return self.is_completed and is_of_controller and tuple(self.inputs) == VEHICLE.input_names

    @property
    def is_completed(self) -> bool:
        """True if the lateral speed is estimated: logs have speed and yaw rate or heading."""
        has_heading = self.pose is not None and self.pose.yaw is not None
        has_motion = "vx_mps" in self.states and ("yaw_rate_radps" in self.states or has_heading)
        is_measured = any(self.quantity(each) is Quantity.LATERAL_SPEED for each in self.states)
        return self.lateral_speed == "estimated" and has_motion and not is_measured

    @property
    def car_states(self) -> tuple[str, ...]:
        """States of the data set without those of the path."""
        if not self.is_completed:
            return tuple(self.states)
        return (*CAR_STATES, *(name for name in self.states if name not in CAR_STATES))

    @property
    def state_names(self) -> tuple[str, ...]:
        """States of the data set: those of the logs, and with poses those of the path."""
        has_path = self.pose is not None or self.places_roads
        return (*self.car_states, *(PATH_STATES if has_path else ()))

    @property
    def exogenous_names(self) -> tuple[str, ...]:
        """Exogenous signals of the data set."""
        has_path = self.pose is not None or self.places_roads
        return (*self.exogenous, *(VEHICLE.exogenous_names if has_path else ()))

    def quantity(self, name: str) -> Quantity:
        """What a signal measures."""
        return self.read_signals[name].quantity or quantity_of_name(name)

    def name_of(self, quantity: Quantity) -> str | None:
        """The first signal that measures this; None if there is none."""
        return next((name for name in self.signals if self.quantity(name) is quantity), None)

    def resolve_roles(self) -> Roles:
        """The roles in the file, with defaults for those that are not; past in schema order."""
        speeds = [name for name in self.states if self.quantity(name) is Quantity.SPEED]
        path = PATH_STATES if self.state_names == VEHICLE.state_names else ()
        centred, past = (*speeds, *path[:1]), self.roles.past
        remembered = [n for n in (*self.car_states, *self.inputs) if n not in path]
        return Roles(
            centred=centred if self.roles.centred is None else self.roles.centred,
            odd=self.roles.odd,
            past=tuple(n for n in remembered if past is None or n in past),
        )

    def _pose_mistakes(self, pose: PoseMapping) -> list[str]:
        mistakes = []
        if pose.yaw is None and (not self.is_completed or pose.ahead_m or pose.left_m):
            mistakes.append(
                "pose.yaw: expected a heading, found none. It is computed from the course only if "
                "yaw_rate_radps is mapped, v_y is estimated, and the pose is that of the centre of "
                "gravity. Map the heading or, for the first, yaw_rate_radps; or leave [pose] out"
            )
        if pose.is_geographic and pose.reference_line is not None:
            mistakes.append(f"pose: {GEOGRAPHIC_WITH_LINE}")
        return mistakes

    @model_validator(mode="after")
    def _require_consistency(self) -> Self:
        if not self.states or not self.inputs:
            raise ValueError("expected at least one state and one input, found none")
        names = [*self.state_names, *self.inputs, *self.exogenous_names]
        counts = Counter([*names, *self.checks.signals])
        mistakes = [
            f"{name}: expected each name once, found it twice"
            for name in sorted(counts)
            if counts[name] > 1
        ]
        mistakes += self.unit_mistakes()
        mistakes += [
            f"column {each.column}: expected a file, as others have, found none"
            for each in self.every_column
            if self.files and not each.file
        ]
        clocks = (self.time, *(each.time for each in self.every_column if each.time))
        if not self.files and any(clock.file for clock in clocks):
            mistakes.append("time.file: expected a file for each signal too, found none")
        for role, chosen in self.roles.model_dump(exclude_none=True).items():
            known = [*self.car_states, *self.inputs] if role == "past" else names
            unknown = [name for name in chosen if name not in known]
            if unknown:
                mistakes.append(
                    f"roles.{role}: expected names among {', '.join(known)}, found "
                    f"{', '.join(unknown)}"
                )
        of_pose = [] if self.pose is None else self._pose_mistakes(self.pose)
        has_states = self.car_states == CAR_STATES and not self.exogenous
        if self.places_roads and not has_states and not of_pose:
            mistakes.append(
                f"pose without a reference_line: expected the states {', '.join(CAR_STATES)} in "
                f"this order and no exogenous signal, so that roads can be placed under the "
                f"drives, found {', '.join((*self.states, *self.exogenous))}. Name a "
                f"reference_line, or leave [pose] out"
            )
        mistakes += of_pose
        if mistakes:
            raise ValueError("\n".join(mistakes))
        return self


def read_mapping(path: Path) -> tuple[LogMapping, str]:
    """The mapping in a TOML file, and its text. Paths in it are relative to the file.

    Raises:
        ConfigError: the file cannot be read, or fields are missing, unknown or wrong; all such
            fields are named at once.
    """
    text = read_own(path, "mapping", "docs/own-data.md has one to start from.")
    return parse(text, TypeAdapter(LogMapping), str(path), context=path.parent), text
