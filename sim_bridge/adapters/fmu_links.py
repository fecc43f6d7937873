"""`Link`: a channel of a mapping, resolved against the variables of an FMU and converted to SI."""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from math import isclose
from typing import Any, TypeVar

from rt_controller.contract.errors import ConfigError
from rt_controller.mapping.units import (
    Unit,
    find_unit,
    require_unit,
    unit_of_exponents,
    unit_of_name,
)
from sim_bridge.adapters.fmu_file import FmuFile, Value
from sim_bridge.adapters.fmu_mapping import Channel, FmuMapping

_Made = TypeVar("_Made")
_Require = Callable[[FmuFile, str, Any], None]
_Linker = Callable[[FmuFile, str, Channel], "Link"]
REAL_TYPES = ("Real", "Float64", "Float32")


@dataclass(frozen=True, slots=True)
class Link:
    """A resolved channel: target = gain * source + bias, in either direction."""

    field: str
    variable: Any
    gain: float
    bias: float


@dataclass(frozen=True, slots=True)
class Links:
    """A mapping, resolved against the variables of an FMU."""

    inputs: list[Link]
    outputs: list[Link]
    start: list[Link]
    road: list[Link]
    parameters: list[tuple[Any, Value]]
    """variables with their start values"""


def resolve_links(file: FmuFile, mapping: FmuMapping) -> Links:
    """The mapping with the FMU's variables.

    Raises:
        ConfigError: variables are missing, cannot be set, have a unit of another quantity, or are
            named for two inputs; or the communication step does not fit. All of it is listed.
    """
    problems: list[str] = []

    def tried(make: Callable[[], _Made]) -> list[_Made]:
        try:
            return [make()]
        except ConfigError as error:
            problems.append(str(error))
            return []

    def linked(channels: Iterable[tuple[str, Channel | None]], link: _Linker) -> list[Link]:
        named = [(field, channel) for field, channel in channels if channel is not None]
        return [one for f, c in named for one in tried(partial(link, file, f, c))]

    links = Links(
        linked(mapping.inputs, partial(_link_into, require_steered)),
        linked(mapping.outputs, _link_out_of),
        linked(mapping.start, partial(_link_into, require_startable)),
        linked(mapping.road, partial(_link_into, require_steered)),
        [
            (variable, value)
            for name, value in mapping.parameters.items()
            for variable in tried(partial(_parameter, file, name))
        ],
    )
    driven = (*links.inputs, *links.road)
    for name, number in Counter(link.variable.name for link in driven).items():
        if number > 1:
            problems.append(
                f"{file.path.name}: expected a variable of its own for each input, found {name!r} "
                f"twice. One would overwrite the other; correct the mapping file."
            )
    tried(partial(require_internal_step, file, mapping))
    if problems:
        raise ConfigError("\n".join(problems))
    return links


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
            f"of {float(fixed_s):g} s, found {mapping.communication_step_s:g} s. Write "
            f"communication_step_s = {float(fixed_s):g} in the mapping file; it need not be a part "
            f"of the control period."
        )


def require_steered(file: FmuFile, field: str, variable: Any) -> None:
    """Return if a variable may get a new value in every period.

    Raises:
        ConfigError: it is no input and no tunable parameter.
    """
    causality, variability = variable.causality, variable.variability
    if causality == "input" or (causality == "parameter" and variability == "tunable"):
        return
    where = f"{file.path.name}: {field}: expected an input or a tunable parameter"
    if causality == "parameter":
        raise ConfigError(
            f"{where}, found {variable.name!r}, a {variability} parameter: it has one value for "
            f"a whole run. Name it under [parameters] in the mapping file; {field} = false says "
            f"that the FMU has no such input."
        )
    raise ConfigError(
        f"{where}, found {variable.name!r}, which is {causality}. Name another in the mapping "
        f"file; {field} = false says that the FMU has no such input."
    )


def require_startable(file: FmuFile, field: str, variable: Any) -> None:
    """Return if a variable may get a value before a run.

    Raises:
        ConfigError: it is a constant, computed by the FMU, or shapes the FMU.
    """
    is_given = variable.causality in ("parameter", "input") or (
        variable.initial in ("exact", "approx") and variable.causality in ("local", "output")
    )
    if is_given and variable.variability != "constant":
        return
    if variable.causality == "structuralParameter":
        found, remedy = "a structural parameter", "Export the FMU again with the wanted value"
    elif variable.variability == "constant":
        found, remedy = "a constant", "Leave it out"
    else:
        found = f"{variable.causality}, computed by the FMU"
        remedy = "Name a parameter or a variable with a start value"
    raise ConfigError(
        f"{file.path.name}: {field}: expected a variable that can be set before a run, found "
        f"{variable.name!r}, which is {found}. {remedy} in the mapping file."
    )


def _parameter(file: FmuFile, name: str) -> Any:
    variable = file.variable(name)
    require_startable(file, f"parameters.{name}", variable)
    return variable


def _link_into(require: _Require, file: FmuFile, field: str, channel: Channel) -> Link:
    variable = _require_real(file, field, channel)
    require(file, field, variable)
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
