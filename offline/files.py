"""Files that are replaced as a whole."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rt_controller.contract.files import atomic_write


def write_text(file: Path, text: str) -> None:
    """Replace the file by this text."""
    with atomic_write(file) as stream:
        stream.write(text.encode())


def write_json(file: Path, fields: Mapping[str, Any]) -> None:
    """Replace the file by these fields as JSON."""
    write_text(file, json.dumps(dict(fields), indent=2) + "\n")
