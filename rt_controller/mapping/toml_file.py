"""TOML files that a person writes (mappings, cars, scenarios): reading and checking.

All errors of a file are reported at once, each with the name of its field.
"""

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.settings_errors import dotted, explain

T = TypeVar("T")


def read_own(
    path: str | Path, kind: str, remedy: str = "Correct the file, or name another."
) -> str:
    """The text of a person's file.

    Args:
        path: of the file.
        kind: what it should be, for the message.
        remedy: what to do, likewise.

    Raises:
        ConfigError: it cannot be read.
    """
    from rt_controller.contract.files import read_text  # numpy, which --help does without

    try:
        return read_text(Path(path))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"{path}: expected a {kind} file in UTF-8 that can be read, found an error: {error}. "
            f"{remedy}"
        ) from error


def parse(
    text: str,
    schema: TypeAdapter[T],
    where: str,
    context: object = None,
    remedies: Mapping[str, str] = MappingProxyType({}),
) -> T:
    """The content of a TOML file, checked against `schema`; `context` is for its validators.

    `remedies` has a sentence by the name of a field, for a line that finds it out of its
    place or missing.

    Raises:
        ConfigError: the text is no TOML, or fields are missing, unknown or out of their limits; the
            message starts with `where` and has one line for each error.
    """
    return checked(parse_table(text, where), schema, where, context, remedies)


def parse_table(text: str, where: str) -> dict[str, Any]:
    """The content of a TOML file, not checked yet.

    Raises:
        ConfigError: the text is no TOML.
    """
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # no TOML, or a number without end
        raise ConfigError(
            f"{where}: expected a TOML file, found an error: {error}. Correct the file."
        ) from error


def checked(
    raw: Mapping[str, Any],
    schema: TypeAdapter[T],
    where: str,
    context: object = None,
    remedies: Mapping[str, str] = MappingProxyType({}),
) -> T:
    """The same of content that is read already."""
    try:
        return schema.validate_python(raw, context=context)
    except ValidationError as error:
        explained = explain(error, dotted, getattr(schema, "_type", None))
        for name, remedy in remedies.items():
            line = rf"^((?:\S+\.)?{name}: (?:no such setting|expected a value, found none).*)$"
            explained = re.sub(line, rf"\1 {remedy}", explained, flags=re.MULTILINE)
        raise ConfigError(listed(where, explained.splitlines())) from error


def listed(where: str, lines: list[str]) -> str:
    """One line, or one below `where` for each of several."""
    return f"{where}: {lines[0]}" if len(lines) == 1 else "\n  ".join([f"{where}:", *lines])
