"""The mapping file: which variable of an FMU is which signal of the contract.

It is TOML, by default beside the FMU under the same name: `car.fmu`, `car.toml`.
"""

from collections import Counter
from collections.abc import Iterable, Mapping
from math import isclose
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BeforeValidator, Field, GetPydanticSchema, TypeAdapter, create_model

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.names import near_names
from rt_controller.contract.signals import ControlInput
from rt_controller.mapping.toml_file import parse, read_own
from rt_controller.mapping.units import (
    Unit,
    find_unit,
    require_unit,
    unit_of_exponents,
    unit_of_name,
)
from sim_bridge.plant.protocol import MOTION_FIELDS, PlantOutputs, RoadAt
from sim_bridge.toml_file import FileTable

_Finite = Annotated[float, Field(allow_inf_nan=False)]


class Channel(FileTable):
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
"""None, `false` in the file: the plant has no such input, and its value is not used"""


def _channels(
    optional: Iterable[str] = (), required: Iterable[str] = (), kind: object = _Named
) -> GetPydanticSchema:
    """A table with a channel for each of these names."""
    fields: dict[str, Any] = dict.fromkeys(optional, (_Named | None, None))
    table = create_model(
        "Table", __base__=FileTable, **fields | dict.fromkeys(required, (kind, ...))
    )
    return GetPydanticSchema(lambda _, schema_of: schema_of(table))


class FmuMapping(FileTable):
    """A whole mapping file; its tables have a `Channel` or None by the name of each field."""

    communication_step_s: Annotated[_Finite, Field(ge=1e-5, le=1.0)]
    """time between two exchanges of values; usually a part of the control period"""
    inputs: Annotated[FileTable, _channels(required=ControlInput._fields, kind=_Input)]
    outputs: Annotated[FileTable, _channels(PlantOutputs._fields, MOTION_FIELDS)]
    start: Annotated[FileTable, _channels(("vx_mps", "road_friction", "road_friction_right"))] = (
        FileTable()
    )
    """parameters of the FMU that a run sets; the others keep the values of the FMU. With
    `road_friction_right`, `road_friction` is that under the left wheels"""
    road: Annotated[FileTable, _channels(RoadAt._fields)] = FileTable()
    """inputs or tunable parameters that follow the road in every period"""
    parameters: dict[str, bool | int | float | str] = Field(default_factory=dict)
    """start values of further variables, by name, in the FMU's own units"""


def load_mapping(path: Path) -> FmuMapping:
    """The mapping in a TOML file.

    Raises:
        ConfigError: there is no file, or fields are missing, unknown or out of their limits.
    """
    remedy = "Write one (docs/plants.md shows how) or name it in `plant_mapping`."
    text = read_own(path, "mapping of the FMU's variables", remedy)
    return parse(text, TypeAdapter(FmuMapping), str(path))


class Link(NamedTuple):
    """A channel with its variable in the FMU: target = gain * source + bias."""

    field: str
    variable: Any
    gain: float
    bias: float


class Links(NamedTuple):
    """A mapping with the variables of an FMU; `parameters` with their start values."""

    inputs: list[Link]
    outputs: list[Link]
    start: list[Link]
    road: list[Link]
    parameters: list[tuple[Any, bool | int | float | str]]


def resolve_links(description: Any, name: str, mapping: FmuMapping) -> Links:
    """The mapping with the variables of an FMU, from its model description and its name.

    Raises:
        ConfigError: variables are missing, cannot be set, have a unit of another quantity, or are
            named for two inputs; or the communication step does not fit. All of it is listed.
    """
    links, problems = Links([], [], [], [], []), list[str]()
    variables = {variable.name: variable for variable in description.modelVariables}
    tables = ("inputs", "outputs", "start", "road")
    channels = [(table, *each) for table in tables for each in getattr(mapping, table)]
    channels += [("parameters", n, Channel(variable=n)) for n in mapping.parameters]
    for table, field, channel in channels:
        if channel is None:
            continue
        try:
            variable = _variable(variables, table, field, channel.variable)
            if table == "parameters":
                links.parameters.append((variable, mapping.parameters[field]))
            else:
                link = _link(description, table == "outputs", field, channel, variable)
                getattr(links, table).append(link)
        except ConfigError as error:
            problems.append(str(error))
    driven = Counter(link.variable.name for link in (*links.inputs, *links.road))
    problems += [
        f"expected a variable of its own for each input, found {variable!r} twice. "
        f"One would overwrite the other; correct the mapping file."
        for variable, number in driven.items()
        if number > 1
    ]
    step_s = mapping.communication_step_s
    own_s = float(getattr(description.coSimulation, "fixedInternalStepSize", None) or step_s)
    if round(step_s / own_s) < 1 or abs(step_s / own_s - round(step_s / own_s)) > 1e-6:
        problems.append(
            f"communication_step_s: expected a multiple of the FMU's own step of "
            f"{own_s:g} s, found {step_s:g} s. Write communication_step_s = {own_s:g} in the "
            f"mapping file; it need not be a part of the control period."
        )
    if problems:
        raise ConfigError("\n".join(f"{name}: {problem}" for problem in problems))
    return links


def _variable(variables: Mapping[str, Any], table: str, field: str, name: str) -> Any:
    """A variable that may be read, or set: of inputs and road in every period, else before a run.

    Raises:
        ConfigError: there is none.
    """
    if name not in variables:
        near = near_names(name, variables, most=5) or list(variables)[:8]
        raise ConfigError(
            f"expected a variable {name!r}, found none of that name ({', '.join(near)}, …). "
            f"Correct the mapping file."
        )
    variable = variables[name]
    causality, variability = variable.causality, variable.variability
    if table in ("inputs", "road"):
        is_fit = causality == "input" or (causality, variability) == ("parameter", "tunable")
        expected = "an input or a tunable parameter"
        remedy = f"Name another, or {field} = false for an FMU without such an input"
    else:
        is_given = causality in ("parameter", "input") or (
            variable.initial in ("exact", "approx") and causality in ("local", "output")
        )
        is_fit = table == "outputs" or (is_given and variability != "constant")
        expected, remedy = "a parameter or a variable with a start value", "Name another"
    if not is_fit:
        raise ConfigError(
            f"{field}: expected {expected}, found {name!r}, which is "
            f"{variability} {causality}. {remedy} in the mapping file."
        )
    return variable


def _link(description: Any, is_output: bool, field: str, channel: Channel, variable: Any) -> Link:
    if variable.type not in ("Real", "Float64", "Float32") or variable.dimensions:
        raise ConfigError(
            f"{field}: expected a scalar of real numbers, found {variable.name!r} of type "
            f"{variable.type}{list(variable.shape or ())}. Name another in the mapping file."
        )
    # The unit of the mapping, else that of the FMU, else that of the signal.
    signal_name = unit_of_name(field) or "1"
    declared = variable.unit or (variable.declaredType.unit if variable.declaredType else None)
    known = _declared_unit(description, declared) if declared else None
    unit, signal = known, require_unit(signal_name, field)
    if channel.unit or unit is None:
        named = channel.unit or declared or signal_name
        unit = require_unit(named, f"{field}: {variable.name!r}")
    # Tools write rounded factors.
    if known is not None and not (
        known.quantity == unit.quantity and isclose(known.factor, unit.factor, rel_tol=1e-4)
    ):
        raise ConfigError(
            f"{field}: expected the FMU's own unit {declared!r}, found {channel.unit!r} in the "
            f"mapping file. Leave the unit out or correct it; a factor belongs into scale."
        )
    if unit.quantity != signal.quantity and channel.scale is None:
        raise ConfigError(
            f"{field}: expected {variable.name!r} to measure {signal.quantity}, found "
            f"{unit.quantity}. Give with scale how much {unit.quantity} is one unit of "
            f"{signal.quantity}, both in SI."
        )
    scale = channel.sign * (channel.scale or 1.0)
    if is_output:
        bias = (channel.offset + scale * unit.offset) / signal.factor
        return Link(field, variable, scale * unit.factor / signal.factor, bias)
    bias = (channel.offset - unit.offset) / unit.factor
    return Link(field, variable, scale * signal.factor / unit.factor, bias)


def _declared_unit(description: Any, declared: str) -> Unit | None:
    """The unit from the base units in the model description, else from its name."""
    for definition in description.unitDefinitions:
        base = definition.baseUnit
        if definition.name == declared and base is not None:
            if base.A or base.K or base.mol or base.cd or base.offset:
                return None
            return unit_of_exponents(base.kg, base.m, base.s, base.rad, base.factor)
    return find_unit(declared)
