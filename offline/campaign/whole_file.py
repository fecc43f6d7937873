"""Files that are there whole or not at all, whoever is killed while writing them."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def write_whole(file: Path, text: str) -> None:
    """Put the text there in one stroke; until then the file is as it was."""
    part = file.with_name(f".{file.name}.{os.getpid()}.part")  # two commands may share the folder
    part.write_text(text, encoding="utf-8")
    os.replace(part, file)


def write_json(file: Path, fields: Mapping[str, Any]) -> None:
    """The fields as JSON, whole."""
    write_whole(file, json.dumps(dict(fields), indent=2) + "\n")
