"""The mapping file as learning and driving share it: signals, pose, DBC, car, and what to drive."""

from typing import Annotated, Any, Literal, Self

from pydantic import Field, FiniteFloat, PositiveFloat, model_validator

from rt_controller.mapping.quantity import Quantity, quantity_of_name, si_unit_of_name
from rt_controller.mapping.tables import (
    CanSettings,
    CarData,
    ColumnMapping,
    MappingTable,
    PoseMapping,
    SignalMapping,
)
from rt_controller.mapping.units import find_unit

ChecksumKind = Literal["crc8_0x1d", "crc8_0x2f", "xor8", "sum8"]
"""CRC-8 of AUTOSAR (SAE J1850) or CRC8H2F, exclusive or, or sum of all other bytes of the frame"""
Value = SignalMapping | FiniteFloat
"""a signal of the bus, or a constant in SI"""


class Checksum(MappingTable):
    """Checksum of a message: eight bits over all of its other bytes, and those of `data_id`."""

    signal: str
    """one whole byte of the frame"""
    kind: ChecksumKind
    data_id: tuple[Annotated[int, Field(ge=0, le=255)], ...] = ()
    """bytes that are not transmitted, after those of the frame"""


class MessageMapping(MappingTable):
    """Protection and period of a message, and what else a message with commands contains."""

    period_s: PositiveFloat | None = None
    """None: GenMsgCycleTime of the DBC; of a command at least a control period"""
    counter: str | None = None
    """signal that counts up by one with each frame"""
    checksum: Checksum | None = None
    driving: dict[str, FiniteFloat] = Field(default_factory=dict)
    """other signals of a message with commands, while the controller drives or brakes the car"""
    standby: dict[str, FiniteFloat] = Field(default_factory=dict)
    """the same while it does not"""


class CommandsMapping(MappingTable):
    """Signals of the car that receive the inputs of the controller."""

    throttle: ColumnMapping
    brake_n: ColumnMapping
    steer_rad: ColumnMapping
    mode: ColumnMapping | None = None
    """number of the controller's mode, see the value table of ACT_CMD.Mode"""


class ReferenceMapping(MappingTable):
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
    """raw values that mean on, all others mean off; None: SI values above 0.5"""


class MissionMapping(MappingTable):
    """Who starts and ends the drive."""

    engage: SwitchMapping | Literal[True]
    """on while the controller is to drive; true: from its start to its end"""
    acknowledge: SwitchMapping | None = None
    """on: request to leave a safe stop"""
    car_brakes: SwitchMapping | None = None
    """on while the car does not follow the commands: its own watchdog, or its driver"""


class CarSignals(MappingTable):
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
        """x, y and yaw; empty without [pose]."""
        return (self.pose.x, self.pose.y, self.pose.yaw) if self.pose else ()

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


CAR_STATES = ("vx_mps", "vy_mps", "yaw_rate_radps", "ey_m", "epsi_rad")
"""states that a car may measure; progress is computed"""
REQUIRED_STATES = ("vx_mps", "yaw_rate_radps")
INPUTS = ("throttle", "brake_n", "steer_rad")


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
        missing = [name for name in REQUIRED_STATES if name not in self.states]
        if missing:
            mistakes.append(
                f"states: expected {', '.join(REQUIRED_STATES)}, found none for "
                f"{', '.join(missing)}. Map a signal of the car"
            )
        for table, known in (("states", CAR_STATES), ("inputs", INPUTS)):
            unknown = [name for name in getattr(self, table) if name not in known]
            if unknown:
                mistakes.append(
                    f"{table}: expected names among {', '.join(known)}, found "
                    f"{', '.join(unknown)}. The controller drives with these only; leave the "
                    f"others out, or keep them in a file for offline-import"
                )
        if self.inputs and len(self.inputs) < len(INPUTS):
            mistakes.append(
                f"inputs: expected all of {', '.join(INPUTS)} or none, found "
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
        elif has_line and len(place) == 1:
            mistakes.append(
                f"states: expected ey_m and epsi_rad together or neither, found {place[0]} alone. "
                f"Leave it out: [pose] has a reference_line"
            )
        if mistakes:
            raise ValueError("\n".join(mistakes))
        return self
