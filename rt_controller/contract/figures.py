"""The file of every `--json`: the figures of a command, for programs."""

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from rt_controller.contract.errors import ConfigError, OutputError


def require_writable(
    path: Path | None,
    option: str = "--json",
    *,
    suffix: str = "",
    inputs: Iterable[str | Path | None] = (),
) -> None:
    """Return if a file can be written there later; no file is made. With None there is no file.

    A long run must not end without its file.

    Args:
        path: of the file.
        option: that named it.
        suffix: that the name must have; empty: any.
        inputs: files that the command reads, or names of something else.

    Raises:
        ConfigError: it cannot.
    """
    if path is None:
        return
    if not path.name.lower().endswith(suffix):
        raise ConfigError(
            f"{option} {path}: expected a file name that ends in {suffix}, found another one."
        )
    obstacle = _obstacle(path)
    if not obstacle and any(each and _is_same(path, Path(each)) for each in inputs):
        obstacle = "a file that this command reads"
    if obstacle:
        raise ConfigError(
            f"{option} {path}: expected a file that can be written, found {obstacle}. Name another "
            f"file, in a folder that exists."
        )


def require_folder(path: Path | None, option: str) -> None:
    """Return if a folder of that name exists or can be made later; with None there is none.

    Raises:
        ConfigError: it cannot.
    """
    if path is None:
        return
    nearest = next(each for each in (path, *path.absolute().parents) if each.exists())
    if not nearest.is_dir() or not os.access(nearest, os.W_OK | os.X_OK):
        raise ConfigError(
            f"{option} {path}: expected a folder that can be made, found {nearest}, which is no "
            f"folder or closed to writing. Name another one."
        )


def write_figures(path: Path | None, figures: Mapping[str, Any] | Sequence[Any]) -> None:
    """Write the figures as JSON, in place of a file that exists; None writes nothing.

    A number that is not finite becomes null, since JSON has no infinity.

    Raises:
        OutputError: the file can no longer be written; an existing one is left as it was.
    """
    if path is None:
        return
    finite = json.loads(json.dumps(figures), parse_constant=lambda infinite: None)
    text = json.dumps(finite, indent=2, allow_nan=False) + "\n"
    from rt_controller.contract.files import atomic_write  # numpy, which --help does without

    try:
        with atomic_write(path) as file:
            file.write(text.encode())
    except OSError as error:
        raise OutputError(
            f"--json {path}: expected room for the figures, found {error.strerror}. The run itself "
            f"is done; only this file is missing. Free some space before the next one."
        ) from error


def _is_same(path: Path, other: Path) -> bool:
    with suppress(OSError):
        return path.samefile(other)
    return False


def _obstacle(path: Path) -> str | None:
    """The reason why no file can be written there; None if it can."""
    try:
        with suppress(FileNotFoundError, NotADirectoryError):
            path.stat()  # a link that leads to itself neither exists nor can be made
        if path.is_dir():
            return "a folder of that name"
        if path.is_fifo():
            return "a named pipe"
        if path.exists():
            return None if os.access(path, os.W_OK) else "a file without permission to write"
        if not path.parent.is_dir():
            return f"no folder {path.parent}"
    except OSError as error:
        return error.strerror
    return None if os.access(path.parent, os.W_OK | os.X_OK) else "a folder closed to writing"
