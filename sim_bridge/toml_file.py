"""TOML files that a person writes (cars, scenarios, FMU mappings): reading and checking.

All errors of a file are reported at once, each with the name of its field.
"""

import re
import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.settings_errors import dotted, explain

T = TypeVar("T")


def shipped_names(folder: str) -> list[str]:
    """Names of the TOML files in a folder of the package, without `.toml`."""
    files = (resources.files("sim_bridge") / folder).iterdir()
    return sorted(file.name.removesuffix(".toml") for file in files if file.name.endswith(".toml"))


def read_shipped_or_own(name_or_path: str | Path, folder: str, kind: str) -> str:
    """The text of a shipped file by its name, or of any file by a path that ends in `.toml`.

    Args:
        folder: of the package, with the shipped files.
        kind: "car", "scenario": for messages.

    Raises:
        ConfigError: there is no such file.
    """
    name = str(name_or_path)
    if name in shipped_names(folder):
        return (resources.files("sim_bridge") / folder / f"{name}.toml").read_text("utf-8")
    if not name.endswith(".toml"):
        raise ConfigError(
            f"{kind} {name!r}: expected one of {', '.join(shipped_names(folder))} or the path of a "
            f".toml file."
        )
    try:
        return Path(name).read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"{name}: expected a {kind} file that can be read, found an error: {error}."
        ) from error


def parse(
    text: str,
    schema: TypeAdapter[T],
    where: str,
    context: object = None,
    remedies: Mapping[str, str] = MappingProxyType({}),
) -> T:
    """The content of a TOML file, checked against `schema`; `context` is for its validators.

    `remedies` has sentences by the names of fields that may be in a wrong section.

    Raises:
        ConfigError: the text is no TOML, or fields are missing, unknown or out of their limits; the
            message starts with `where` and has one line for each error.
    """
    try:
        raw: dict[str, Any] = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{where}: expected a TOML file, found an error: {error}.") from error
    try:
        return schema.validate_python(raw, context=context)
    except ValidationError as error:
        explained = _explain(error)
        for name, remedy in remedies.items():
            misplaced = rf"^(\S+\.{name}: no such setting\.)$"
            explained = re.sub(misplaced, rf"\1 {remedy}", explained, flags=re.MULTILINE)
        lines = explained.splitlines()
        listed = f" {lines[0]}" if len(lines) == 1 else "".join(f"\n  {line}" for line in lines)
        raise ConfigError(f"{where}:{listed}") from error


def _explain(refused: ValidationError) -> str:
    """A check of several fields together names them in its own message."""
    errors = refused.errors()
    if not errors[0]["loc"] and "error" in errors[0].get("ctx", {}):
        return str(errors[0]["ctx"]["error"])
    return explain(refused, dotted)
