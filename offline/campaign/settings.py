"""Training configurations with fields that a file or a command line changes, each one checked."""

import shlex
import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import Field, TypeAdapter, ValidationError

from offline.config import TrainingConfig
from rt_controller.contract.errors import ConfigError

NONE = "none"
"""what TOML has no word for"""

OF_THE_DATA = ("episodes", "data_seed")
"""fields that follow from the folder of the data set"""

Slug = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9.-]*$")]
"""a name that is also one of a folder"""

Entries = TypeVar("Entries")


def changed(base: TrainingConfig, changes: Mapping[str, Any], where: str) -> TrainingConfig:
    """The configuration with other values; "none" stands for None.

    Raises:
        ConfigError: there is no such field, or it may not have that value.
    """
    new = {field: None if value == NONE else value for field, value in changes.items()}
    try:
        return TrainingConfig.model_validate({**base.model_dump(), **new})
    except ValidationError as error:
        raise ConfigError(f"{where}: {_first_complaint(error)}") from error


def explicit_fields(common: TrainingConfig | None, instead: Mapping[str, str]) -> dict[str, Any]:
    """Fields that all trainings of a campaign get; one thread each unless others are asked for.

    `instead` are fields that are no matter of an option, with what takes its place.

    Raises:
        ConfigError: one of those was given.
    """
    fields = {name: getattr(common, name) for name in common.model_fields_set} if common else {}
    for name, place in instead.items():
        if name in fields:
            raise ConfigError(f"--{name}: expected {place} in its place, found {fields[name]!r}.")
    # As many trainings as cores: a second thread of one would wait for another.
    return {"threads": 1, **fields}


def read_entries(
    file: Path | None, shipped: str, option: str, form: "TypeAdapter[Entries]"
) -> Entries:
    """What a TOML file holds, checked; None: the file of that name that ships.

    Raises:
        ConfigError: it cannot be read, or holds something else.
    """
    where = file if file is not None else resources.files("offline.campaign") / shipped
    try:
        return form.validate_python(tomllib.loads(where.read_text(encoding="utf-8")))
    except OSError as error:
        raise ConfigError(
            f"{option} {where}: expected a file that can be read, found: {error.strerror}."
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{where}: expected a TOML file, found: {error}.") from error
    except ValidationError as error:
        raise ConfigError(f"{where}: {_first_complaint(error)}") from error


def train_command(config: TrainingConfig, preset: TrainingConfig, data: Path) -> str:
    """The command line that trains this configuration on the data set in that folder."""
    options = [f"--preset {config.preset}"]
    for field in TrainingConfig.model_fields:
        value = getattr(config, field)
        if field not in OF_THE_DATA and value != getattr(preset, field):
            options.append(_option(field, value))
    return " ".join(("offline-train", *options, f"--data {shlex.quote(str(data))}"))


def _option(field: str, value: Any) -> str:
    name = field.replace("_", "-")
    if value is None or value is False:
        return f"--no-{name}"
    if value is True:
        return f"--{name}"
    if isinstance(value, tuple):
        return " ".join(f"--{name} {part}" for part in value)
    return f"--{name} {value}"


def _first_complaint(error: ValidationError) -> str:
    first = error.errors()[0]
    place = ".".join(str(part) for part in first["loc"])
    return f"expected another {place!r}, found {first['input']!r} ({first['msg']})."
