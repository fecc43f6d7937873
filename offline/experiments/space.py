"""Search spaces of a study, read from TOML: the fields to search and their values."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, TypeAdapter, model_validator

from offline.config import PRESETS, TrainingConfig
from offline.experiments.settings import FolderName, Preset, changed, read_toml, require_unique
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.settings_errors import option

SHIPPED = "spaces.toml"


class Parameter(BaseModel, frozen=True, extra="forbid"):
    """A field of the training configuration and the values to search."""

    field: str
    low: int | float | None = None
    high: int | float | None = None
    scale: Literal["linear", "log"] = "linear"
    choices: Annotated[tuple[Any, ...], Field(min_length=1)] | None = None

    @model_validator(mode="after")
    def _has_range_or_choices(self) -> "Parameter":
        if self.choices is not None and (self.low, self.high) == (None, None):
            return self
        if self.choices is not None or self.low is None or self.high is None:
            raise ValueError("expected either low and high, or choices")
        if not self.low < self.high:
            raise ValueError("expected low below high")
        if self.scale == "log" and not self.low > 0:
            raise ValueError("expected low above zero on a log scale")
        return self

    @property
    def is_integer(self) -> bool:
        """True if both ends of the range are integers."""
        return isinstance(self.low, int) and isinstance(self.high, int)

    @property
    def json_choices(self) -> tuple[str, ...]:
        """The choices as JSON: Optuna stores only simple values."""
        return tuple(json.dumps(choice) for choice in self.choices or ())


@dataclass(frozen=True, slots=True)
class Space:
    """A base configuration and the parameters that are searched."""

    name: str
    base: TrainingConfig
    parameters: tuple[Parameter, ...]

    def values(self, params: Mapping[str, Any]) -> dict[str, Any]:
        """Values of the fields for the parameters that Optuna stored."""
        with_choices = {each.field for each in self.parameters if each.choices is not None}
        return {
            field: json.loads(value) if field in with_choices else value
            for field, value in params.items()
        }

    def configure(self, values: Mapping[str, Any]) -> TrainingConfig:
        """The base configuration with these values."""
        return changed(self.base, values, self.name)


class _Space(BaseModel, extra="forbid"):
    why: str
    base: Preset
    common: dict[str, Any] = {}
    parameter: Annotated[list[Parameter], Field(min_length=1)]


_SPACES = TypeAdapter(dict[FolderName, _Space])


def read_space(name: str, file: Path | None, common: Mapping[str, Any]) -> Space:
    """The search space of that name.

    `file` None is the shipped file; `common` has the fields that options set for all trials.

    Raises:
        ConfigError: the file, the space or a field is not as expected, a choice or an end of a
            range is no value of its field, or an option sets a field that is searched.
    """
    spaces = read_toml(file, SHIPPED, "--spaces", _SPACES)
    if name not in spaces:
        known = ", ".join(spaces) or "the spaces of the file, which has none"
        raise ConfigError(f"space: expected one of {known}, found {name!r}.")
    found = spaces[name]
    base = changed(changed(PRESETS[found.base], found.common, name), common, name)
    require_unique([parameter.field for parameter in found.parameter], name)
    for parameter in found.parameter:
        if parameter.field in common:
            raise ConfigError(
                f"{name}: expected no option for a field that is searched, found "
                f"{option((parameter.field,))}. Leave it out."
            )
        for value in parameter.choices or (parameter.low, parameter.high):
            changed(base, {parameter.field: value}, f"{name}, {parameter.field}")
    return Space(name, base, tuple(found.parameter))
