"""A disk that does not answer delays no tick; the drive ends, and says what is missing."""

import fcntl
import json
import os
from pathlib import Path

import pytest
from virtual_drive import SHORT_LANE_CHANGE

from rt_controller.cli import app
from rt_controller.contract.errors import OutputError

_PIPE_BYTES = 4096


@pytest.mark.nightly
def test_a_drive_goes_on_while_the_disk_does_not_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In place of the disk a pipe that is not read: full after a fifth of a second of frames."""
    monkeypatch.setattr("rt_controller.bus.log.recorder.LONGEST_CLOSE_S", 0.1)
    pipe, figures_file = tmp_path / "run.log", tmp_path / "figures.json"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        fcntl.fcntl(reader, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        files = ("--scenario", SHORT_LANE_CHANGE, "--record", str(pipe), "--json", figures_file)
        options = f"--bus virtual --channel {tmp_path.name} --model lti --quiet"
        late = ("--max-misses", "100000")
        arguments = [*options.split(), *late, *map(str, files)]
        assert app.meta(arguments, result_action="return_value") == OutputError.exit_code
    finally:
        os.close(reader)
    figures = json.loads(figures_file.read_text())
    assert figures["ending"] == "MISSION_OVER"
    assert figures["log_frames_dropped"] > 500
    assert "too slow" in figures["log_failure"]
    assert "frames are missing in the log" in capsys.readouterr().err
