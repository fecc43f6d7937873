"""The file of every `--json`: the figures of a command, for programs."""

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rt_controller.contract.errors import ConfigError, RtControllerError


def require_writable(path: Path | None, option: str = "--json") -> None:
    """Return if a file can be written there later; no file is made. None asks for no file.

    `option` is the option that named it. A long run must not end without its file.

    Raises:
        ConfigError: it cannot.
    """
    if path is None:
        return
    obstacle = _obstacle(path)
    if obstacle:
        raise ConfigError(
            f"{option} {path}: expected a file that can be written, found {obstacle}. Name another "
            f"file, in a folder that exists."
        )


def write_figures(path: Path | None, figures: Mapping[str, Any] | Sequence[Any]) -> None:
    """Write the figures as JSON; None writes nothing.

    A number that is not finite becomes null, since JSON has no infinity.

    Raises:
        RtControllerError: the file can no longer be written.
    """
    if path is None:
        return
    finite = json.loads(json.dumps(figures), parse_constant=lambda infinite: None)
    text = json.dumps(finite, indent=2, allow_nan=False) + "\n"
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise RtControllerError(
            f"--json {path}: expected room for the figures, found {error.strerror}. The run itself "
            f"is done; only this file is missing."
        ) from error


def _obstacle(path: Path) -> str | None:
    """The reason why no file can be written there; None if it can."""
    try:
        if path.is_dir():
            return "a folder of that name"
        if path.exists():
            return None if os.access(path, os.W_OK) else "a file without permission to write"
        if not path.parent.is_dir():
            return f"no folder {path.parent}"
    except OSError as error:
        return error.strerror
    return None if os.access(path.parent, os.W_OK | os.X_OK) else "a folder closed to writing"
