"""Streams that never raise: a pipe or disk that has gone must not end a drive."""

import subprocess
import sys
from pathlib import Path

import pytest

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


@pytest.mark.parametrize(
    ("target", "expected"), [("a closed pipe", ["stderr", "stdout"]), ("/dev/full", ["stdout"])]
)
def test_output_that_cannot_be_written_raises_nothing_and_is_remembered(
    tmp_path: Path, target: str, expected: list[str]
) -> None:
    result, is_pipe = tmp_path / "lost", target == "a closed pipe"
    if not is_pipe and not Path(target).exists():
        pytest.skip(f"no {target} on this system")
    with subprocess.Popen(
        [sys.executable, "-c", PRINT_LATE, result],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE if is_pipe else Path(target).open("wb"),
        stderr=subprocess.PIPE if is_pipe else subprocess.DEVNULL,
    ) as process:
        for stream in (process.stdout, process.stderr, process.stdin):
            if stream is not None:
                stream.close()
        assert process.wait() == 6
    assert result.read_text() == f"{expected}\n"
