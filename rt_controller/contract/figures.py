"""The file behind every `--json`: the figures that a command claims, for a program to check."""

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rt_controller.contract.errors import ConfigError, RtControllerError


def require_writable(path: Path | None, option: str = "--json") -> None:
    """Return if a file can be written there later; None asks for no file, and none is made.

    `option` is what the user named it by.

    Raises:
        ConfigError: they cannot. Better known before a long run than after it.
    """
    if path is None:
        return
    obstacle = find_obstacle(path)
    if obstacle:
        raise ConfigError(
            f"{option} {path}: expected a file that can be written, found {obstacle}. Name another "
            f"file, in a folder that exists."
        )


def write_figures(path: Path | None, figures: Mapping[str, Any]) -> None:
    """Write the figures as JSON; None writes nothing.

    JSON knows no infinity: a number that is not finite becomes null.

    Raises:
        RtControllerError: the place that was there before the run is not there any more.
    """
    if path is None:
        return
    text = json.dumps(_finite(figures), indent=2, allow_nan=False) + "\n"
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise RtControllerError(
            f"--json {path}: expected room for the figures, found {error.strerror}. The run itself "
            f"is done; only this file is missing."
        ) from error


def find_obstacle(path: Path) -> str | None:
    """What stands in the way of a file there, in words; None if nothing does."""
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


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
