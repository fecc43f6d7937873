"""The mapping file: which variable of an FMU is which signal of the contract.

It is TOML, by default beside the FMU under the same name: `car.fmu`, `car.toml`.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, TypeAdapter, create_model

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import read_text
from rt_controller.contract.signals import ControlInput
from rt_controller.mapping.toml_file import parse
from sim_bridge.plant.protocol import MOTION_FIELDS, PlantOutputs, RoadAt

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


def _expand_name(raw: object) -> object:
    return {"variable": raw} if isinstance(raw, str) else raw


def _none_if_false(raw: object) -> object:
    return None if raw is False else raw


NamedChannel = Annotated[Channel, BeforeValidator(_expand_name)]
"""a channel, or only the variable's name"""
Input = Annotated[NamedChannel | None, BeforeValidator(_none_if_false)]
"""None, `false` in the file: the plant has no such input, and its value is not used"""


if TYPE_CHECKING:
    InputMapping = _Strict
    OutputMapping = _Strict
    StartMapping = _Strict
    RoadMapping = _Strict
else:
    _Optional = (NamedChannel | None, None)
    # All inputs and the motion must be named, further outputs and start values may be.
    InputMapping = create_model(
        "InputMapping", __base__=_Strict, **dict.fromkeys(ControlInput._fields, (Input, ...))
    )
    OutputMapping = create_model(
        "OutputMapping",
        __base__=_Strict,
        **dict.fromkeys(MOTION_FIELDS, (NamedChannel, ...)),
        **dict.fromkeys(PlantOutputs._fields, _Optional),
    )
    # With `road_friction_right`, `road_friction` is that under the left wheels.
    StartMapping = create_model(
        "StartMapping",
        __base__=_Strict,
        **dict.fromkeys(("vx_mps", "road_friction", "road_friction_right"), _Optional),
    )
    # What of a road that changes on the way acts on the FMU: inputs or tunable parameters.
    RoadMapping = create_model(
        "RoadMapping", __base__=_Strict, **dict.fromkeys(RoadAt._fields, _Optional)
    )


class FmuMapping(_Strict):
    """A whole mapping file."""

    communication_step_s: Annotated[_Finite, Field(ge=1e-5, le=1.0)]
    """time between two exchanges of values; usually a part of the control period, see `FmuClock`"""
    inputs: InputMapping
    outputs: OutputMapping
    start: StartMapping = StartMapping()
    """parameters of the FMU that a run sets; the others keep the values of the FMU"""
    road: RoadMapping = RoadMapping()
    """inputs or tunable parameters that follow the road in every period"""
    parameters: dict[str, bool | int | float | str] = {}
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
