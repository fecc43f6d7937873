"""TOML files that a person writes (mappings, cars, scenarios): reading and checking.

All errors of a file are reported at once, each with the name of its field.
"""

import re
import tomllib
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.settings_errors import dotted, explain

T = TypeVar("T")


def parse(
    text: str,
    schema: TypeAdapter[T],
    where: str,
    context: object = None,
    remedies: Mapping[str, str] = MappingProxyType({}),
) -> T:
    """The content of a TOML file, checked against `schema`.

    Raises:
        ConfigError: the text is no TOML, or see `validated`.
    """
    try:
        raw: dict[str, Any] = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # no TOML, or a number without end
        raise ConfigError(
            f"{where}: expected a TOML file, found an error: {error}. Correct the file."
        ) from error
    return validated(raw, schema, where, context, remedies)


def validated(
    raw: Mapping[str, Any],
    schema: TypeAdapter[T],
    where: str,
    context: object = None,
    remedies: Mapping[str, str] = MappingProxyType({}),
) -> T:
    """Parsed content, checked against `schema`; `context` is for its validators.

    `remedies` has sentences by the names of fields that may be in a wrong section.

    Raises:
        ConfigError: fields are missing, unknown or out of their limits; the message starts with
            `where` and has one line for each error.
    """
    try:
        return schema.validate_python(raw, context=context)
    except ValidationError as error:
        explained = explain(error, dotted, getattr(schema, "_type", None))
        for name, remedy in remedies.items():
            misplaced = rf"^(\S+\.{name}: no such setting.*)$"
            explained = re.sub(misplaced, rf"\1 {remedy}", explained, flags=re.MULTILINE)
        raise refusal(where, explained.splitlines()) from error


def refusal(where: str, lines: Sequence[str]) -> ConfigError:
    """The error of a file with these lines."""
    return ConfigError(
        f"{where}: {lines[0]}" if len(lines) == 1 else "\n  ".join([f"{where}:", *lines])
    )
