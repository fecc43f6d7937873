"""The user's folder for files that can be made again."""

import os
from contextlib import suppress
from pathlib import Path


def user_cache_folder() -> Path | None:
    """The folder of this project, made if needed; None where nothing can be written.

    A system account may have no home, and the home of a container may be read-only.
    """
    try:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        folder = base / "rt-controller"
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # RuntimeError: the user has no home
        return None
    return folder if os.access(folder, os.W_OK | os.X_OK) else None


def is_marked(folder: str, name: str) -> bool:
    """True if `mark` has been called with these names on this machine."""
    cache = user_cache_folder()
    return cache is not None and (cache / folder / name).exists()


def mark(folder: str, name: str) -> None:
    """Keep an empty file of this name, which says that a check has passed; none without a cache."""
    cache = user_cache_folder()
    if cache is not None:
        with suppress(OSError):
            (cache / folder).mkdir(exist_ok=True)
            (cache / folder / name).touch()
