"""Reading a mapping file; paths in it are relative to the file itself."""

import tomllib
from pathlib import Path

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from offline.logs.mapping import Mapping
from rt_controller.contract.errors import ConfigError


def read_mapping(path: Path) -> tuple[Mapping, str]:
    """The mapping in a TOML file, with its text.

    Raises:
        ConfigError: the file cannot be read, or a field is missing, unknown or makes no sense; all
            such fields are named at once.
    """
    try:
        text = path.read_text(encoding="utf-8")
        mapping = Mapping.model_validate(tomllib.loads(text))
    except OSError as error:
        raise ConfigError(
            f"{path}: expected a mapping file in TOML, found nothing readable ({error.strerror}). "
            f"docs/own-data.md has one to start from."
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: expected TOML, found a mistake: {error}.") from error
    except ValidationError as error:
        mistakes = "\n".join(
            f"  {'.'.join(map(str, each['loc'])) or 'the file'}: {_words(each)}"
            for each in error.errors()
        )
        raise ConfigError(
            f"{path}: expected a mapping as in docs/own-data.md, found:\n{mistakes}"
        ) from error
    return _relative_to(mapping, path.parent), text


def _words(mistake: ErrorDetails) -> str:
    if mistake["type"] == "extra_forbidden":
        return "expected a known field, found none of that name"
    if mistake["type"] == "missing":
        return "expected that field, found nothing"
    if mistake["type"] == "value_error":
        return mistake["msg"].removeprefix("Value error, ")
    return f"{mistake['msg']}, found {mistake['input']!r}"


def _relative_to(mapping: Mapping, folder: Path) -> Mapping:
    changes: dict[str, object] = {}
    if mapping.can:
        changes["can"] = mapping.can.model_copy(update={"dbc": folder / mapping.can.dbc})
    if mapping.pose and mapping.pose.reference_line:
        line = folder / mapping.pose.reference_line
        changes["pose"] = mapping.pose.model_copy(update={"reference_line": line})
    return mapping.model_copy(update=changes)
