"""`fmu_variables`: the variables of the exported FMU, their start values and their places in C."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from sim_bridge.c_code.annotations import table_of
from sim_bridge.c_code.c_types import field_name
from sim_bridge.fmu_export.exported_car import OUTPUT_FIELDS, ExportedInput, ExportedStart
from sim_bridge.fmu_export.field_notes import Limits, field_notes, limits_of
from sim_bridge.fmu_export.fmu_units import FmuUnit, unit_of, words_of
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.protocol import FASTEST_START_MPS, PlantOutputs

START = ExportedStart(v0_mps=20.0, ey0_m=0.0, epsi0_rad=0.0)
_TUNABLE = "road."
"""start of the names of parameters that may change during a run: the road, not the car"""
_LIMITS = {
    "throttle": Limits(0.0, 1.0),
    "brake_n": Limits(0.0, 1e300),
    "v0_mps": Limits(0.0, FASTEST_START_MPS),
}
_NUMBER = Limits(-1e300, 1e300)
_NOTES = {
    "vx_mps": "velocity of the centre of gravity, forward",
    "vy_mps": "velocity of the centre of gravity, to the left",
    "yaw_rate_radps": "yaw rate, positive to the left",
    "s_m": "progress along the reference line; on a straight road the position x",
    "ey_m": "distance to the left of the reference line; on a straight road the position y",
    "epsi_rad": "heading relative to the reference line; on a straight road the yaw angle",
}
_DISCRETE = ("out_gear",)


class Role(Enum):
    """What a variable is; the value is its name in `car.h`."""

    TIME = "CAR_TIME"
    INPUT = "CAR_INPUT"
    FIXED = "CAR_FIXED"
    TUNABLE = "CAR_TUNABLE"
    OUTPUT = "CAR_OUTPUT"


@dataclass(frozen=True, slots=True)
class FmuVariable:
    """A variable; its value reference is its position in the list."""

    name: str
    role: Role
    place: str
    """in the struct `Car`"""
    description: str
    unit: FmuUnit
    start: float | None = None
    limits: Limits = field(default=_NUMBER)
    is_discrete: bool = False


def fmu_variables(parameters: Parameters, sources: dict[str, str]) -> list[FmuVariable]:
    """All variables: time, inputs, start, outputs, parameters of the car.

    Args:
        sources: by name of a parameter ("body.mass_kg"): where its value comes from.
    """
    return [
        FmuVariable("time", Role.TIME, "time_s", "simulated time", unit_of("time_s")),
        *(_plain(name, ExportedInput, Role.INPUT, "inputs", 0.0) for name in ExportedInput._fields),
        *(
            _plain(name, ExportedStart, Role.FIXED, "start", getattr(START, name))
            for name in ExportedStart._fields
        ),
        *_outputs(),
        *_parameters(parameters, sources),
    ]


def _plain(name: str, kind: type, role: Role, place: str, start: float) -> FmuVariable:
    return FmuVariable(
        name,
        role,
        f"{place}.{name}",
        field_notes(kind)[name],
        unit_of(name),
        start,
        _LIMITS.get(name, _NUMBER),
    )


def _parameters(parameters: Parameters, sources: dict[str, str]) -> Iterator[FmuVariable]:
    """Numbers of the car.

    Compiled in and not shown are switches (bool, int), and parts that this car does not have: those
    that are the default of `Parameters`.
    """
    absent = tuple(
        f"{part}."
        for part, default in Parameters._field_defaults.items()
        if getattr(parameters, part) == default
    )
    for name, place, owner, value in _fields(parameters):
        if not isinstance(value, float) or name.startswith(absent):
            continue
        plain = name.partition("[")[0]
        part, _, last = plain.rpartition(".")
        note = field_notes(owner).get(last, "")
        text = f"{part.replace('.', ' ')}: {words_of(last)}{f', {note}' if note else ''}"
        source = sources.get(plain) or sources.get(part)
        yield FmuVariable(
            name,
            Role.TUNABLE if name.startswith(_TUNABLE) else Role.FIXED,
            f"parameters.{place}",
            f"{text} ({source})" if source else text,
            unit_of(last),
            value,
            _within(limits_of(owner, last)),
        )


def _fields(owner: Any, name: str = "", place: str = "") -> Iterator[tuple[str, str, type, Any]]:
    """(name in the FMU, place in C, named tuple, value) of all numbers in a named tuple."""
    for one, value in zip(owner._fields, owner, strict=True):
        full_name, full_place = f"{name}{one}", f"{place}{field_name(one)}"
        if hasattr(value, "_fields"):
            yield from _fields(value, f"{full_name}.", f"{full_place}.")
            continue
        for index, at, number in _scalars(value):
            yield f"{full_name}{index}", f"{full_place}{at}", type(owner), number


def _scalars(value: Any, index: str = "", place: str = "") -> Iterator[tuple[str, str, Any]]:
    """(index in the FMU, from 1; place in C; value) of a number or of a table of numbers."""
    value = table_of(value)
    if not isinstance(value, tuple):
        yield (f"[{index}]" if index else ""), place, value
        return
    for i, item in enumerate(value):
        inner = f"{index},{i + 1}" if index else str(i + 1)
        yield from _scalars(item, inner, f"{place}.at[{i}]")


def _within(limits: Limits) -> Limits:
    """Limits that C can write."""
    return limits._replace(
        lower=max(limits.lower, _NUMBER.lower), upper=min(limits.upper, _NUMBER.upper)
    )


def _outputs() -> Iterator[FmuVariable]:
    notes = field_notes(PlantOutputs)
    for i, name in enumerate(OUTPUT_FIELDS):
        plain = name.removeprefix("out_")
        note = _NOTES.get(name) or ", ".join(
            text for text in (words_of(plain), notes.get(plain)) if text
        )
        yield FmuVariable(
            name, Role.OUTPUT, f"outputs[{i}]", note, unit_of(name), is_discrete=name in _DISCRETE
        )
