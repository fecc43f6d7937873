"""The file behind every `--json`: the figures that a command claims, for a program to check."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rt_controller.contract.errors import ConfigError


def require_writable(path: Path | None) -> None:
    """Return if figures can be written there later; None asks for no file.

    Raises:
        ConfigError: they cannot. Better known before a long run than after it.
    """
    if path is None:
        return
    try:
        path.open("a").close()
    except OSError as error:
        raise ConfigError(
            f"--json {path}: expected a file that can be written, found {error.strerror}. Name "
            f"another file, in a folder that exists."
        ) from error


def write_figures(path: Path | None, figures: Mapping[str, Any]) -> None:
    """Write the figures as JSON; None writes nothing."""
    if path is not None:
        path.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
