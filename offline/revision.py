"""Which state of the source tree is running."""

import subprocess
from pathlib import Path

UNKNOWN = "unknown"
DIRTY = "-dirty"

NOT_SOURCE = "rt_controller/models"
"""what export writes; delivering one bundle does not make the next one's revision dirty"""


def source_revision() -> str:
    """Revision of the tree this package runs from, with "-dirty" if a tracked file differs.

    "unknown" outside of a repository.
    """
    here = Path(__file__).parent
    revision = _git(here, "describe", "--always", "--abbrev=12")
    if not revision:
        return UNKNOWN
    paths = (":(top)", f":(top,exclude){NOT_SOURCE}")
    changed = _git(here, "status", "--porcelain", "--untracked-files=no", "--", *paths)
    return UNKNOWN if changed is None else revision + (DIRTY if changed else "")


def _git(folder: Path, *arguments: str) -> str | None:
    """What git answers, None if it cannot."""
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
