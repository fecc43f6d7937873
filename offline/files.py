"""JSON files that are replaced as a whole."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rt_controller.contract.files import write_text


def write_json(file: Path, fields: Mapping[str, Any]) -> None:
    """Replace the file by these fields as JSON."""
    write_text(file, json.dumps(dict(fields), indent=2) + "\n")
