"""A drive of `rt-controller` on the virtual bus, in this process."""

import json
from pathlib import Path
from typing import Any

from rt_controller.cli import app

Figures = dict[str, Any]
SHORT_LANE_CHANGE = str(Path(__file__).parent / "short_lane_change.toml")
"""a scenario"""


def drive(
    folder: Path, model: str | Path, *options: str, pace: str = "lockstep", channel: str = ""
) -> Figures:
    """The summary of a drive that ended with exit code 0; it is also in `folder`."""
    summary = folder / "summary.json"
    command = f"--bus virtual --pace {pace} --quiet --channel {channel or folder.name}"
    files = ("--model", str(model), "--json", str(summary))
    code = app.meta([*command.split(), *files, *options], result_action="return_value")
    assert code == 0
    figures: Figures = json.loads(summary.read_text())
    return figures
