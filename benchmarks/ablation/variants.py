"""Training configurations that a TOML file or a command line changes; every change is checked."""

from collections.abc import Collection, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field, TypeAdapter, ValidationError

from offline.config import PRESETS, TrainingConfig, explicit_fields
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import read_text
from rt_controller.contract.settings_errors import dotted, explain, option
from rt_controller.mapping.toml_file import T, parse

NONE = "none"
"""stands for None in TOML files"""


def _require_preset(name: str) -> str:
    if name not in PRESETS:
        raise ValueError(f"expected one of the presets {', '.join(PRESETS)}")
    return name


Preset = Annotated[str, AfterValidator(_require_preset)]
FolderName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9.-]*$")]


def changed(base: TrainingConfig, changes: Mapping[str, Any], where: str) -> TrainingConfig:
    """The configuration with these fields changed; "none" stands for None.

    A field that does not exist or accept the value is a `ConfigError` that begins with `where`.
    """
    new = {field: None if value == NONE else value for field, value in changes.items()}
    try:
        return TrainingConfig.model_validate({**base.model_dump(), **new})
    except ValidationError as error:
        raise ConfigError(f"{where}: {explain(error, dotted, TrainingConfig)}") from error


def common_fields(common: TrainingConfig | None, instead: Mapping[str, str]) -> dict[str, Any]:
    """Fields that the options set for all trainings; one thread each unless an option says more.

    `instead` has the fields that are no option of this command, and what to use in their place;
    one of them in `common` is a `ConfigError`.
    """
    fields = explicit_fields(common)
    for name, place in instead.items():
        if name in fields:
            raise ConfigError(f"--{name}: expected {place} in its place, found {fields[name]!r}.")
    # There are as many trainings as cores: a second thread would wait for another training.
    return {"threads": 1, **fields}


def read_toml(file: Path | None, shipped: str, option: str, form: TypeAdapter[T]) -> T:
    """The checked content of a TOML file; None: of the file `shipped` in this package.

    Raises:
        ConfigError: the file cannot be read, or its content has another form.
    """
    where = file if file is not None else resources.files("offline.experiments") / shipped
    try:
        text = where.read_text(encoding="utf-8") if file is None else read_text(file)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{option} {where}: expected a readable file, found: {error}.") from error
    return parse(text, form, str(where))


def require_consistent(
    where: str, names: Sequence[str], fields: Collection[str], common: Collection[str]
) -> None:
    """Return if every name occurs once, and no option of `common` sets one of these fields.

    Raises:
        ConfigError: otherwise.
    """
    if repeated := sorted({name for name in names if names.count(name) > 1}):
        raise ConfigError(f"{where}: expected every name once, found {', '.join(repeated)} again.")
    if undone := sorted(set(fields) & set(common)):
        raise ConfigError(
            f"{where}: expected no option for a field that is set here, found "
            f"{option((undone[0],))}. Leave it out."
        )
