"""The mapping of an FMU: which of its variables is which signal of the contract.

It is a TOML file, by default beside the FMU under the same name: `car.fmu`, `car.toml`. `resolve`
finds the variables in the FMU and the factors between their units and SI.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from math import isclose
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, TypeAdapter, create_model

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import read_text
from rt_controller.contract.signals import ControlInput
from rt_controller.mapping.toml_file import parse
from rt_controller.mapping.units import (
    Unit,
    find_unit,
    require_unit,
    unit_of_exponents,
    unit_of_name,
)
from sim_bridge.plant.protocol import MOTION_FIELDS, PlantOutputs, RoadAt

Value = bool | int | float | str
_Use = Literal["input", "output", "start", "parameter"]
"""set in every period, read, set before a run, set before a run without units"""
_REAL_TYPES = ("Real", "Float64", "Float32")
_Finite = Annotated[float, Field(allow_inf_nan=False)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Channel(_Strict):
    """One variable, and the conversion between its values and those of the contract.

    Towards the FMU: variable = sign * scale * contract + offset.
    From the FMU: contract = sign * scale * variable + offset.
    The variable has its own unit, the contract SI units; scale and offset are in SI on both sides.
    """

    variable: str
    unit: str | None = None
    scale: Annotated[_Finite, Field(gt=0)] | None = None
    """needed if the unit is of another quantity than the signal: pressure per force"""
    offset: _Finite = 0.0
    sign: Literal[1, -1] = 1


_Named = Annotated[
    Channel, BeforeValidator(lambda raw: {"variable": raw} if isinstance(raw, str) else raw)
]
"""a channel, or only the variable's name"""
_Input = Annotated[_Named | None, BeforeValidator(lambda raw: None if raw is False else raw)]
"""None, `false` in the file: the FMU has no such input, and its value is not used"""

if TYPE_CHECKING:
    from pydantic import BaseModel as _Inputs
    from pydantic import BaseModel as _Outputs
    from pydantic import BaseModel as _Road
    from pydantic import BaseModel as _Start
else:

    def _section(required: dict[str, Any], optional: Iterable[str] = ()) -> type[_Strict]:
        fields = {name: (kind, ...) for name, kind in required.items()}
        fields |= dict.fromkeys(optional, (_Named | None, None))
        return create_model("Section", __base__=_Strict, **fields)

    _Inputs = _section(dict.fromkeys(ControlInput._fields, _Input))
    _Outputs = _section(dict.fromkeys(MOTION_FIELDS, _Named), PlantOutputs._fields)
    # With `road_friction_right`, `road_friction` is that under the left wheels.
    _Start = _section({}, ("vx_mps", "road_friction", "road_friction_right"))
    _Road = _section({}, RoadAt._fields)


class FmuMapping(_Strict):
    """A whole mapping file."""

    communication_step_s: Annotated[_Finite, Field(ge=1e-5, le=1.0)]
    """time between two exchanges of values; usually a part of the control period"""
    inputs: _Inputs
    outputs: _Outputs
    """the motion must be named, further outputs may be"""
    start: _Start = _Start()
    """parameters of the FMU that a run sets; the others keep the values of the FMU"""
    road: _Road = _Road()
    """inputs or tunable parameters that follow the road in every period"""
    parameters: dict[str, Value] = {}
    """start values of further variables, by name, in the FMU's own units"""


_SCHEMA = TypeAdapter(FmuMapping)


def load_mapping(path: Path) -> FmuMapping:
    """The mapping in a TOML file.

    Raises:
        ConfigError: there is no file, or fields are missing, unknown or out of their limits.
    """
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"{path}: expected the mapping from the FMU's variables to the contract, found an "
            f"error: {error}. Write one (docs/plants.md shows how) or name it in `plant_mapping`."
        ) from error
    return parse(text, _SCHEMA, str(path))


class Link(NamedTuple):
    """A channel and its variable: target = gain * source + bias, in either direction."""

    field: str
    variable: Any
    """from the description of the FMU"""
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


def resolve(mapping: FmuMapping, description: Any, fmu: str) -> Links:
    """The mapping with the FMU's variables.

    Args:
        description: of the FMU, as fmpy reads it.
        fmu: name of the file for messages.

    Raises:
        ConfigError: variables are missing, cannot be set, have a unit of another quantity, or are
            named for two inputs; or the communication step does not fit. All of it is listed.
    """
    problems: list[str] = []

    def linked(channels: Iterable[tuple[str, Channel | None]], use: _Use) -> list[Link]:
        found = []
        for field, channel in channels:
            if channel is not None:
                try:
                    found.append(_link(description, f"{fmu}: {field}", field, channel, use))
                except ConfigError as error:
                    problems.append(str(error))
        return found

    named = [(name, Channel(variable=name)) for name in mapping.parameters]
    links = Links(
        linked(mapping.inputs, "input"),
        linked(mapping.outputs, "output"),
        linked(mapping.start, "start"),
        linked(mapping.road, "input"),
        [(link.variable, mapping.parameters[link.field]) for link in linked(named, "parameter")],
    )
    written = Counter(link.variable.name for link in (*links.inputs, *links.road))
    problems += [
        f"{fmu}: expected a variable of its own for each input, found {name!r} twice. One would "
        f"overwrite the other; correct the mapping file."
        for name, number in written.items()
        if number > 1
    ]
    fixed_s = float(getattr(description.coSimulation, "fixedInternalStepSize", None) or 0.0)
    ratio = mapping.communication_step_s / fixed_s if fixed_s else 1.0
    if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-6:
        problems.append(
            f"{fmu}: communication_step_s: expected a multiple of the FMU's own step of "
            f"{fixed_s:g} s, found {mapping.communication_step_s:g} s. Write communication_step_s "
            f"= {fixed_s:g} in the mapping file; it need not be a part of the control period."
        )
    if problems:
        raise ConfigError("\n".join(problems))
    return links


def _link(description: Any, where: str, field: str, channel: Channel, use: _Use) -> Link:
    variables = {variable.name: variable for variable in description.modelVariables}
    name = channel.variable
    if name not in variables:
        near = get_close_matches(name, variables, n=5, cutoff=0.4) or list(variables)[:8]
        raise ConfigError(
            f"{where}: expected a variable {name!r}, found none of that name "
            f"({', '.join(near)}, …). Correct the mapping file."
        )
    variable = variables[name]
    if use != "parameter" and (variable.type not in _REAL_TYPES or variable.dimensions):
        raise ConfigError(
            f"{where}: expected a scalar of real numbers, found {name!r} of type "
            f"{variable.type}{list(variable.shape or ())}. Name another variable in the mapping "
            f"file."
        )
    if use != "output":
        _require_settable(where, variable, use)
    if use == "parameter":
        return Link(field, variable, 1.0, 0.0)
    unit, signal = _units(description, where, field, channel, variable)
    scale = channel.sign * (channel.scale or 1.0)
    if use == "output":
        bias = (channel.offset + scale * unit.offset) / signal.factor
        return Link(field, variable, scale * unit.factor / signal.factor, bias)
    gain = scale * signal.factor / unit.factor
    return Link(field, variable, gain, (channel.offset - unit.offset) / unit.factor)


def _require_settable(where: str, variable: Any, use: _Use) -> None:
    """Return if a variable may be set in every period ("input"), or before a run."""
    causality, variability = variable.causality, variable.variability
    if use == "input":
        is_settable = causality == "input" or (causality, variability) == ("parameter", "tunable")
        wanted = "an input or a tunable parameter"
        remedy = "A value for the whole run belongs under [parameters]; false: no such input"
    else:
        has_start = causality in ("local", "output") and variable.initial in ("exact", "approx")
        is_settable = variability != "constant" and (
            causality in ("parameter", "input") or has_start
        )
        wanted = "a parameter, an input or a variable with a start value"
        remedy = "Leave it out, or export the FMU again with the wanted value"
    if not is_settable:
        raise ConfigError(
            f"{where}: expected {wanted}, found {variable.name!r}, a {variability} {causality}. "
            f"Name another in the mapping file. {remedy}."
        )


def _units(
    description: Any, where: str, field: str, channel: Channel, variable: Any
) -> tuple[Unit, Unit]:
    """Units of the variable and of the contract's signal, which must be of one quantity.

    The unit of the variable is that of the mapping, else that of the FMU, else that of the signal.
    """
    signal_name = unit_of_name(field) or "1"
    signal = require_unit(signal_name, where)
    declared = variable.unit or (variable.declaredType.unit if variable.declaredType else None)
    known = _declared_unit(description, declared) if declared else None
    if channel.unit is None:
        unit = known or require_unit(declared or signal_name, f"{where}: {channel.variable!r}")
    else:
        unit = require_unit(channel.unit, f"{where}: {channel.variable!r}")
        # Tools write rounded factors.
        is_same = known is None or (
            known.quantity == unit.quantity and isclose(known.factor, unit.factor, rel_tol=1e-4)
        )
        if not is_same:
            raise ConfigError(
                f"{where}: {channel.variable!r}: expected the FMU's own unit {declared!r}, found "
                f"{channel.unit!r} in the mapping file. Leave the unit out or correct it; a factor "
                f"belongs into scale."
            )
    if unit.quantity != signal.quantity and channel.scale is None:
        raise ConfigError(
            f"{where}: expected {channel.variable!r} to measure {signal.quantity}, found "
            f"{unit.quantity}. Give with scale how much {unit.quantity} is one unit of "
            f"{signal.quantity}, both in SI."
        )
    return unit, signal


def _declared_unit(description: Any, declared: str) -> Unit | None:
    """The unit from the base units in the model description, else from its name."""
    for definition in description.unitDefinitions:
        base = definition.baseUnit
        if definition.name == declared and base is not None:
            if base.A or base.K or base.mol or base.cd or base.offset:
                return None
            return unit_of_exponents(base.kg, base.m, base.s, base.rad, base.factor)
    return find_unit(declared)
