"""Values that `python -m benchmarks.tuning` has found."""

import json
from pathlib import Path
from typing import cast


def tuned_values(name: str) -> dict[str, float]:
    """Weights or gains of a baseline, by their names."""
    text = Path(__file__).with_name(f"{name}.json").read_text(encoding="utf-8")
    return cast("dict[str, float]", json.loads(text)["values"])
