"""What a person or a full disk does to the process in mid-drive."""

import json
import subprocess
from pathlib import Path

import pytest

from benchmarks.processes import program

DRIVE = ("--bus", "virtual", "--pace", "lockstep", "--scenario", "straight", "--model", "lti")


def run_without_reader(*options: str) -> int:
    """Exit code of a drive whose output has no reader after its first line."""
    command = program("rt_controller.cli", *DRIVE, *options)
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as running:
        assert running.stdout is not None
        running.stdout.readline()
        running.stdout.close()
        return running.wait()


@pytest.mark.nightly
def test_a_drive_goes_on_without_its_output_and_says_so(tmp_path: Path) -> None:
    figures = tmp_path / "figures.json"
    assert run_without_reader("--json", str(figures)) == 9
    found = json.loads(figures.read_text())
    assert found["ending"] == "MISSION_OVER"
    assert found["lost_output"]


@pytest.mark.nightly
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_a_log_on_a_full_disk_is_said_at_once_and_at_the_end(tmp_path: Path) -> None:
    figures = tmp_path / "figures.json"
    command = program("rt_controller.cli", *DRIVE, "--quiet", "--record", "/dev/full")
    done = subprocess.run(
        [*command, "--json", str(figures)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 9
    assert "expected room for the log" in done.stderr
    found = json.loads(figures.read_text())
    assert found["log_frames_written"] == 0
    assert found["log_frames_dropped"] > 1000
    assert "No space left" in found["log_failure"]
