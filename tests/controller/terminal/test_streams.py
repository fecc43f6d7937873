"""Streams that never raise: a pipe or disk that has gone must not end a drive."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from rt_controller.terminal.streams import LossyFile

PRINT_LATE = """
import sys
from rt_controller.terminal.streams import lost_output, protect_streams
protect_streams()
sys.stdin.read()
for stream in (sys.stdout, sys.stderr):
    for _ in range(3):
        print("a line of progress", file=stream)
    stream.flush()
with open(sys.argv[1], "w") as file:
    print(sorted(lost_output()), file=file)
sys.exit(6)
"""


def test_a_pipe_without_a_reader_raises_nothing_and_is_remembered(tmp_path: Path) -> None:
    result = tmp_path / "lost"
    with subprocess.Popen(
        [sys.executable, "-c", PRINT_LATE, result],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        for stream in (process.stdout, process.stderr, process.stdin):
            assert stream is not None
            stream.close()
        assert process.wait() == 6
    assert result.read_text() == "['stderr', 'stdout']\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_a_full_disk_raises_nothing_and_is_remembered(tmp_path: Path) -> None:
    with Path("/dev/full").open("wb") as full:
        code = subprocess.run(
            [sys.executable, "-c", PRINT_LATE, tmp_path / "lost"],
            stdin=subprocess.DEVNULL,
            stdout=full,
            stderr=subprocess.DEVNULL,
            check=False,
        ).returncode
    assert code == 6
    assert (tmp_path / "lost").read_text() == "['stdout']\n"


def test_a_reader_that_does_not_read_holds_up_progress_for_a_limited_time() -> None:
    readable, writable = os.pipe()
    with LossyFile(writable, longest_wait_s=0.001) as stream:
        size = 1 << 20
        assert stream.write(bytes(size)) == size
        assert "does not read" in stream.failure
    assert len(os.read(readable, size)) < size
    os.close(readable)
    os.close(writable)
