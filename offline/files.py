"""JSON files that are replaced as a whole, and the revision that is written into them."""

import json
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rt_controller.contract.files import write_text

NOT_SOURCE = "rt_controller/models"
"""written by offline-export, so a change there does not make the source dirty"""


def write_json(file: Path, fields: Mapping[str, Any]) -> None:
    """Replace the file by these fields as JSON."""
    write_text(file, json.dumps(dict(fields), indent=2) + "\n")


def source_revision() -> str:
    """Git revision of this package, with "-dirty" if a tracked file was changed.

    "unknown" outside a repository.
    """
    here = Path(__file__).parent
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
