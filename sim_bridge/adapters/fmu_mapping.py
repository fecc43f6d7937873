"""The mapping file: which variable of an FMU is which signal of the contract.

It is TOML, and by default lies beside the FMU under the same name: `car.fmu`, `car.toml`.
"""

import tomllib
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.timing import PERIOD_S


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Channel(_Strict):
    """One variable, and how its numbers become those of the contract.

    Towards the FMU: variable = sign * scale * contract + offset.
    From the FMU: contract = sign * scale * variable + offset.
    The variable counts in its unit, the contract in SI; scale and offset are in SI on both sides.
    """

    variable: str
    unit: str | None = None
    scale: float | None = Field(default=None, gt=0.0, allow_inf_nan=False)
    """needed where the unit measures something else than the contract: pressure per force"""
    offset: float = Field(default=0.0, allow_inf_nan=False)
    sign: Literal[1, -1] = 1


def _named(raw: object) -> object:
    return {"variable": raw} if isinstance(raw, str) else raw


NamedChannel = Annotated[Channel, BeforeValidator(_named)]
"""a channel, or just the variable's name"""
Input = NamedChannel | Literal[False]
"""false: this plant has no such input, and what is asked of it is lost"""


class InputMapping(_Strict):
    """Where the driver's hands and feet go; `ControlInput`."""

    throttle: Input
    brake_n: Input
    steer_rad: Input


class OutputMapping(_Strict):
    """Where the motion comes from, and what else the plant knows; `PlantOutputs`."""

    vx_mps: NamedChannel
    vy_mps: NamedChannel
    yaw_rate_radps: NamedChannel
    ax_mps2: NamedChannel | None = None
    ay_mps2: NamedChannel | None = None
    roll_rad: NamedChannel | None = None
    pitch_rad: NamedChannel | None = None
    road_wheel_rad: NamedChannel | None = None
    throttle: NamedChannel | None = None
    brake_mpa: NamedChannel | None = None
    gear: NamedChannel | None = None
    engine_rpm: NamedChannel | None = None
    load_front_left_n: NamedChannel | None = None
    load_front_right_n: NamedChannel | None = None
    load_rear_left_n: NamedChannel | None = None
    load_rear_right_n: NamedChannel | None = None


class StartMapping(_Strict):
    """Parameters that the run decides; what is not named is the FMU's own business."""

    vx_mps: NamedChannel | None = None
    road_friction: NamedChannel | None = None


class FmuMapping(_Strict):
    """A whole mapping file."""

    communication_step_s: float = Field(gt=0.0, allow_inf_nan=False)
    """how long the FMU computes between two looks at it; a whole number of them is 25 ms"""
    inputs: InputMapping
    outputs: OutputMapping
    start: StartMapping = StartMapping()
    parameters: dict[str, bool | int | float | str] = {}
    """start values of further variables, by name, in the FMU's own units"""

    @property
    def steps_per_period(self) -> int:
        """Communication steps in a control period."""
        return round(PERIOD_S / self.communication_step_s)


def mapping_beside(fmu: Path) -> Path:
    """Where the mapping of an FMU lies unless another is named."""
    return fmu.with_suffix(".toml")


def load_mapping(path: Path) -> FmuMapping:
    """The mapping in a TOML file.

    Raises:
        ConfigError: there is none, or a name or value in it makes no sense.
    """
    try:
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(
            f"{path}: expected the mapping from the FMU's variables to the contract, found "
            f"nothing readable ({error.strerror}). Write one (docs/plants.md shows how) or name "
            f"it with --plant-mapping."
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: expected a TOML file, found {error}. Correct it.") from error
    try:
        mapping = FmuMapping.model_validate(raw)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(str(part) for part in first["loc"])
        raise ConfigError(
            f"{path}: {field}: {first['msg']}, found {first['input']!r}. docs/plants.md lists "
            f"what a mapping may say."
        ) from error
    n = mapping.steps_per_period
    if n < 1 or abs(n * mapping.communication_step_s - PERIOD_S) > 1e-9:
        raise ConfigError(
            f"{path}: communication_step_s: expected a whole number of steps in {PERIOD_S} s, "
            f"found {mapping.communication_step_s} s. Use 0.025, 0.005, 0.001 or the like."
        )
    return mapping
