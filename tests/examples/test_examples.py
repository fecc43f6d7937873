"""Every example of the public names is short and runs as it is written."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
PROGRAMS = sorted(file for file in EXAMPLES.glob("*.py") if file.name != "plot_log.py")


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda file: file.stem)
def test_an_example_runs(program: Path, tmp_path: Path) -> None:
    found = subprocess.run(
        [sys.executable, str(program)], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert found.returncode == 0, found.stderr
    assert found.stdout


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda file: file.stem)
def test_an_example_has_at_most_thirty_lines_of_code(program: Path) -> None:
    lines = program.read_text(encoding="utf-8").split('"""', 2)[2].strip().splitlines()
    assert len([line for line in lines if line.strip()]) <= 30
