"""Channels of a mapping, resolved against the variables of an FMU: who, which factor, which way."""

from dataclasses import dataclass
from math import isclose
from typing import Any

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import ControlInput
from sim_bridge.adapters.fmu_instance import FmuFile
from sim_bridge.adapters.fmu_mapping import Channel, FmuMapping
from sim_bridge.adapters.units import Unit, find_unit, require_unit, unit_of_exponents

REAL_TYPES = ("Real", "Float64", "Float32")
_FIELD_UNITS = {
    "throttle": "1",
    "brake_n": "N",
    "steer_rad": "rad",
    "vx_mps": "m/s",
    "vy_mps": "m/s",
    "yaw_rate_radps": "rad/s",
    "ax_mps2": "m/s2",
    "ay_mps2": "m/s2",
    "roll_rad": "rad",
    "pitch_rad": "rad",
    "road_wheel_rad": "rad",
    "brake_mpa": "MPa",
    "gear": "1",
    "engine_rpm": "rpm",
    "road_friction": "1",
}


@dataclass(frozen=True, slots=True)
class Link:
    """One channel, resolved: target = gain * source + bias, whichever way it points."""

    field: str
    variable: Any
    gain: float
    bias: float


def resolve_inputs(file: FmuFile, mapping: FmuMapping) -> tuple[Link, ...]:
    """From the contract's inputs to the FMU's.

    Raises:
        ConfigError: a variable is missing, cannot be set, or is meant twice.
    """
    links = []
    for field in ControlInput._fields:
        channel = getattr(mapping.inputs, field)
        if channel is not False:
            links.append(_link_into(file, field, channel, ("input", "parameter")))
    names = [link.variable.name for link in links]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(
                f"{file.path.name}: expected a variable of its own for each input, found {name!r} "
                f"twice. One would overwrite the other; correct the mapping file."
            )
    return tuple(links)


def resolve_start(file: FmuFile, mapping: FmuMapping) -> tuple[Link, ...]:
    """From what a run decides to the FMU's parameters.

    Raises:
        ConfigError: a variable is missing or cannot be set.
    """
    return tuple(
        _link_into(file, field, channel, ("parameter", "input", "local", "output"))
        for field in type(mapping.start).model_fields
        if (channel := getattr(mapping.start, field)) is not None
    )


def resolve_outputs(file: FmuFile, mapping: FmuMapping) -> tuple[Link, ...]:
    """From the FMU's variables to motion and outputs.

    Raises:
        ConfigError: a variable is missing or counts in something else.
    """
    return tuple(
        _link_out_of(file, field, channel)
        for field in type(mapping.outputs).model_fields
        if (channel := getattr(mapping.outputs, field)) is not None
    )


def _link_into(file: FmuFile, field: str, channel: Channel, causalities: tuple[str, ...]) -> Link:
    variable = _require_real(file, field, channel)
    if variable.causality not in causalities:
        raise ConfigError(
            f"{file.path.name}: {field}: expected a variable that can be set "
            f"({' or '.join(causalities[:2])}), found {channel.variable!r}, which is "
            f"{variable.causality}. Name another in the mapping file."
        )
    unit = _unit_of(file, field, channel, variable)
    scale = _scale(file, field, channel, unit)
    return Link(
        field, variable, channel.sign * scale * _si(field) / unit.to_si, channel.offset / unit.to_si
    )


def _link_out_of(file: FmuFile, field: str, channel: Channel) -> Link:
    variable = _require_real(file, field, channel)
    unit = _unit_of(file, field, channel, variable)
    scale = _scale(file, field, channel, unit)
    return Link(
        field, variable, channel.sign * scale * unit.to_si / _si(field), channel.offset / _si(field)
    )


def _require_real(file: FmuFile, field: str, channel: Channel) -> Any:
    variable = file.variable(channel.variable)
    if variable.type not in REAL_TYPES or variable.dimensions:
        raise ConfigError(
            f"{file.path.name}: {field}: expected a scalar of real numbers, found "
            f"{channel.variable!r} of type {variable.type}{list(variable.shape or ())}. Name "
            f"another variable in the mapping file."
        )
    return variable


def _unit_of(file: FmuFile, field: str, channel: Channel, variable: Any) -> Unit:
    """What the mapping says, else what the FMU says, else the contract's own unit."""
    where = f"{file.path.name}: {field}: {channel.variable!r}"
    declared = variable.unit or (variable.declaredType.unit if variable.declaredType else None)
    known = _declared_unit(file, declared) if declared else None
    if channel.unit is None:
        return known or require_unit(declared or _field_unit(field), where)
    unit = require_unit(channel.unit, where)
    if known is not None and not _is_same(known, unit):
        raise ConfigError(
            f"{where}: expected the FMU's own unit {declared!r}, found {channel.unit!r} in the "
            f"mapping file. Leave the unit out or correct it; a factor goes into scale."
        )
    return unit


def _is_same(one: Unit, other: Unit) -> bool:
    # Tools round the factors that they write down.
    return one.dimension == other.dimension and isclose(one.to_si, other.to_si, rel_tol=1e-4)


def _declared_unit(file: FmuFile, declared: str) -> Unit | None:
    """By the base units that the model description gives, else by the spelling."""
    for definition in file.description.unitDefinitions:
        base = definition.baseUnit
        if definition.name == declared and base is not None:
            if base.A or base.K or base.mol or base.cd or base.offset:
                return None
            return unit_of_exponents(base.kg, base.m, base.s, base.rad, base.factor)
    return find_unit(declared)


def _scale(file: FmuFile, field: str, channel: Channel, unit: Unit) -> float:
    wanted = require_unit(_field_unit(field), field)
    if unit.dimension != wanted.dimension and channel.scale is None:
        raise ConfigError(
            f"{file.path.name}: {field}: expected {channel.variable!r} to measure "
            f"{wanted.dimension}, found {unit.dimension}. Say with scale how much "
            f"{unit.dimension} is one unit of {wanted.dimension}, both in SI."
        )
    return 1.0 if channel.scale is None else channel.scale


def _field_unit(field: str) -> str:
    return _FIELD_UNITS.get(field, "N")


def _si(field: str) -> float:
    return require_unit(_field_unit(field), field).to_si


def require_internal_step(file: FmuFile, mapping: FmuMapping) -> None:
    """Return if the FMU can make steps of the mapping's size.

    Raises:
        ConfigError: its own fixed step does not fit into them.
    """
    fixed_s = getattr(file.description.coSimulation, "fixedInternalStepSize", None)
    if fixed_s is None:
        return
    ratio = mapping.communication_step_s / float(fixed_s)
    if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-6:
        raise ConfigError(
            f"{file.path.name}: communication_step_s: expected a multiple of the FMU's own step "
            f"of {float(fixed_s):g} s, found {mapping.communication_step_s:g} s. Correct the "
            f"mapping file."
        )
