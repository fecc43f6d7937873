"""What a search may choose about a training, as data."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, model_validator

from offline.campaign.settings import Slug, changed, read_entries
from offline.config import PRESETS, TrainingConfig
from rt_controller.contract.errors import ConfigError

SHIPPED = "spaces.toml"


class Parameter(BaseModel):
    """A field of the configuration, and the values that it may take."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    field: str
    low: int | float | None = None
    high: int | float | None = None
    scale: Literal["linear", "log"] = "linear"
    choices: tuple[Any, ...] | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> "Parameter":
        has_range = self.low is not None and self.high is not None
        if has_range == (self.choices is not None) or self.choices == ():
            raise ValueError("either low and high, or choices")
        if self.low is not None and self.high is not None and not self.low < self.high:
            raise ValueError("low below high")
        if self.low is not None and self.scale == "log" and not self.low > 0:
            raise ValueError("on a log scale, low above zero")
        return self

    @property
    def is_whole(self) -> bool:
        """Whether the range is one of whole numbers."""
        return isinstance(self.low, int) and isinstance(self.high, int)

    @property
    def words(self) -> tuple[str, ...]:
        """The choices as JSON, which a study can keep."""
        return tuple(json.dumps(choice) for choice in self.choices or ())

    def extremes(self) -> tuple[Any, ...]:
        """Values that stand for all it may take."""
        return self.choices if self.choices is not None else (self.low, self.high)


@dataclass(frozen=True, slots=True)
class Space:
    """A preset with common settings, and the parameters that are searched."""

    name: str
    why: str
    base: TrainingConfig
    parameters: tuple[Parameter, ...]

    def configure(self, values: Mapping[str, Any]) -> TrainingConfig:
        """The configuration with these values of the parameters' fields."""
        return changed(self.base, values, self.name)


class _Space(BaseModel):
    model_config = ConfigDict(extra="forbid")

    why: str
    base: str
    common: dict[str, Any] = {}
    parameter: Annotated[list[Parameter], Field(min_length=1)]


_SPACES = TypeAdapter(dict[Slug, _Space])


def read_space(name: str, file: Path | None, overrides: Mapping[str, Any]) -> Space:
    """The search space of that name in the file, None: the one that ships.

    `overrides` are fields that all trials get on top.

    Raises:
        ConfigError: the file, the space or a field is not as expected, or a value at the edge of
            a range, or a choice, is none that the field may have; or an override is searched.
    """
    spaces = read_entries(file, SHIPPED, "--spaces", _SPACES)
    if name not in spaces:
        raise ConfigError(f"space: expected one of {', '.join(spaces)}, found {name!r}.")
    found = spaces[name]
    if found.base not in PRESETS:
        raise ConfigError(
            f"{name}: expected base to be one of {', '.join(PRESETS)}, found {found.base!r}."
        )
    base = changed(changed(PRESETS[found.base], found.common, name), overrides, name)
    fields = [parameter.field for parameter in found.parameter]
    for parameter in found.parameter:
        if fields.count(parameter.field) > 1:
            raise ConfigError(f"{name}: expected every field once, found {parameter.field} again.")
        if parameter.field in overrides:
            raise ConfigError(
                f"{name}: expected no option for a field that is searched, found "
                f"--{parameter.field.replace('_', '-')}. Leave it out."
            )
        for value in parameter.extremes():
            changed(base, {parameter.field: value}, f"{name}, {parameter.field}")
    return Space(name, found.why, base, tuple(found.parameter))
