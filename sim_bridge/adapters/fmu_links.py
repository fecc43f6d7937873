"""`Link`: a channel of a mapping, resolved against the variables of an FMU and converted to SI."""

from collections import Counter
from dataclasses import dataclass
from math import isclose
from typing import Any

from rt_controller.contract.errors import ConfigError
from sim_bridge.adapters.fmu_file import FmuFile
from sim_bridge.adapters.fmu_mapping import Channel, FmuMapping
from sim_bridge.units import Unit, find_unit, require_unit, unit_of_exponents, unit_of_name

REAL_TYPES = ("Real", "Float64", "Float32")


@dataclass(frozen=True, slots=True)
class Link:
    """A resolved channel: target = gain * source + bias, in either direction."""

    field: str
    variable: Any
    gain: float
    bias: float


def resolve_links(file: FmuFile, mapping: FmuMapping) -> tuple[list[Link], list[Link], list[Link]]:
    """Links of the mapping's inputs, outputs and start values with the FMU's variables.

    Raises:
        ConfigError: a variable is missing, cannot be set, has a unit of another quantity, or is
            named for two inputs.
    """
    inputs = [
        _link_into(file, field, channel, ("input", "parameter"))
        for field, channel in mapping.inputs
        if channel is not None
    ]
    for name, number in Counter(link.variable.name for link in inputs).items():
        if number > 1:
            raise ConfigError(
                f"{file.path.name}: expected a variable of its own for each input, found {name!r} "
                f"twice. One would overwrite the other; correct the mapping file."
            )
    outputs = [
        _link_out_of(file, field, channel)
        for field, channel in mapping.outputs
        if channel is not None
    ]
    start = [
        _link_into(file, field, channel, ("parameter", "input", "local", "output"))
        for field, channel in mapping.start
        if channel is not None
    ]
    return inputs, outputs, start


def require_internal_step(file: FmuFile, mapping: FmuMapping) -> None:
    """Return if the FMU can compute steps of the mapping's size.

    Raises:
        ConfigError: they are no multiple of its own fixed step.
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


def _link_into(file: FmuFile, field: str, channel: Channel, causalities: tuple[str, ...]) -> Link:
    variable = _require_real(file, field, channel)
    if variable.causality not in causalities:
        raise ConfigError(
            f"{file.path.name}: {field}: expected a variable that can be set "
            f"({' or '.join(causalities[:2])}), found {channel.variable!r}, which is "
            f"{variable.causality}. Name another in the mapping file."
        )
    unit, signal = _units(file, field, channel, variable)
    gain = channel.sign * (channel.scale or 1.0) * signal.factor / unit.factor
    return Link(field, variable, gain, (channel.offset - unit.offset) / unit.factor)


def _link_out_of(file: FmuFile, field: str, channel: Channel) -> Link:
    variable = _require_real(file, field, channel)
    unit, signal = _units(file, field, channel, variable)
    scale = channel.sign * (channel.scale or 1.0)
    bias = (channel.offset + scale * unit.offset) / signal.factor
    return Link(field, variable, scale * unit.factor / signal.factor, bias)


def _require_real(file: FmuFile, field: str, channel: Channel) -> Any:
    variable = file.variable(channel.variable)
    if variable.type not in REAL_TYPES or variable.dimensions:
        raise ConfigError(
            f"{file.path.name}: {field}: expected a scalar of real numbers, found "
            f"{channel.variable!r} of type {variable.type}{list(variable.shape or ())}. Name "
            f"another variable in the mapping file."
        )
    return variable


def _units(file: FmuFile, field: str, channel: Channel, variable: Any) -> tuple[Unit, Unit]:
    """Units of the variable and of the contract's signal, which must be of one quantity.

    The unit of the variable is that of the mapping, else that of the FMU, else that of the signal.
    """
    where = f"{file.path.name}: {field}: {channel.variable!r}"
    signal_name = unit_of_name(field) or "1"
    signal = require_unit(signal_name, field)
    declared = variable.unit or (variable.declaredType.unit if variable.declaredType else None)
    known = _declared_unit(file, declared) if declared else None
    if channel.unit is None:
        unit = known or require_unit(declared or signal_name, where)
    else:
        unit = require_unit(channel.unit, where)
        if known is not None and not _is_same(known, unit):
            raise ConfigError(
                f"{where}: expected the FMU's own unit {declared!r}, found {channel.unit!r} in the "
                f"mapping file. Leave the unit out or correct it; a factor belongs into scale."
            )
    if unit.quantity != signal.quantity and channel.scale is None:
        raise ConfigError(
            f"{file.path.name}: {field}: expected {channel.variable!r} to measure "
            f"{signal.quantity}, found {unit.quantity}. Give with scale how much "
            f"{unit.quantity} is one unit of {signal.quantity}, both in SI."
        )
    return unit, signal


def _is_same(one: Unit, other: Unit) -> bool:
    # Tools write rounded factors.
    return one.quantity == other.quantity and isclose(one.factor, other.factor, rel_tol=1e-4)


def _declared_unit(file: FmuFile, declared: str) -> Unit | None:
    """The unit from the base units in the model description, else from its name."""
    for definition in file.description.unitDefinitions:
        base = definition.baseUnit
        if definition.name == declared and base is not None:
            if base.A or base.K or base.mol or base.cd or base.offset:
                return None
            return unit_of_exponents(base.kg, base.m, base.s, base.rad, base.factor)
    return find_unit(declared)
