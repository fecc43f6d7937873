"""Git revision of the source, for `--version` and for what is made with it. Needs no package."""

import subprocess
from pathlib import Path

NOT_SOURCE = "rt_controller/models"
"""written by offline-export, so a change there does not make the source dirty"""
REVISION_FILE = "revision.txt"
"""beside this module, in a wheel: written by hatch_build.py"""


def source_revision() -> str:
    """Git revision of this package, with "-dirty" if a tracked file was changed.

    Of an installed wheel it is the one that the build wrote; "unknown" without both.
    """
    here = Path(__file__).parent
    if (here / REVISION_FILE).is_file():
        return (here / REVISION_FILE).read_text("ascii").strip()
    revision = _git(here, "describe", "--always", "--abbrev=12")
    if not revision:
        return "unknown"
    paths = (":(top)", f":(top,exclude){NOT_SOURCE}")
    changed = _git(here, "status", "--porcelain", "--untracked-files=no", "--", *paths)
    return "unknown" if changed is None else revision + ("-dirty" if changed else "")


def _git(folder: Path, *arguments: str) -> str | None:
    """Output of git; None if it fails or is not installed."""
    try:
        answer = subprocess.run(
            ["git", "--no-optional-locks", *arguments],
            cwd=folder,
            capture_output=True,
            text=True,
            check=True,
            timeout=10,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return answer.stdout.strip()
