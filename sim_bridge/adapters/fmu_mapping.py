"""The mapping file: which variable of an FMU is which signal of the contract.

It is TOML, by default beside the FMU under the same name: `car.fmu`, `car.toml`.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    TypeAdapter,
    create_model,
)

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.plant.protocol import MOTION_FIELDS, PlantOutputs
from sim_bridge.toml_file import parse

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


def _require_whole_steps(step_s: float) -> float:
    n_steps = round(PERIOD_S / step_s)
    if n_steps < 1 or abs(n_steps * step_s - PERIOD_S) > 1e-9:
        raise ValueError(
            f"expected a whole number of steps in {PERIOD_S} s, as with {PERIOD_S}, 0.005 or 0.001"
        )
    return step_s


NamedChannel = Annotated[Channel, BeforeValidator(_expand_name)]
"""a channel, or only the variable's name"""
Input = Annotated[NamedChannel | None, BeforeValidator(_none_if_false)]
"""None, `false` in the file: the plant has no such input, and its value is not used"""


if TYPE_CHECKING:
    InputMapping = _Strict
    OutputMapping = _Strict
    StartMapping = _Strict
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
    StartMapping = create_model(
        "StartMapping", __base__=_Strict, vx_mps=_Optional, road_friction=_Optional
    )


class FmuMapping(_Strict):
    """A whole mapping file."""

    communication_step_s: Annotated[_Finite, Field(gt=0), AfterValidator(_require_whole_steps)]
    """time between two exchanges of values; a whole number of them is a control period"""
    inputs: InputMapping
    outputs: OutputMapping
    start: StartMapping = StartMapping()
    """parameters of the FMU that a run sets; the others keep the values of the FMU"""
    parameters: dict[str, bool | int | float | str] = {}
    """start values of further variables, by name, in the FMU's own units"""


_SCHEMA = TypeAdapter(FmuMapping)


def load_mapping(path: Path) -> FmuMapping:
    """The mapping in a TOML file.

    Raises:
        ConfigError: there is no file, or fields are missing, unknown or out of their limits.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"{path}: expected the mapping from the FMU's variables to the contract, found an "
            f"error: {error}. Write one (docs/plants.md shows how) or name it in `plant_mapping`."
        ) from error
    return parse(text, _SCHEMA, str(path))
