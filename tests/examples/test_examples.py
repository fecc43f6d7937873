"""Every example of the public names is short and runs as it is written."""

import runpy
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
PROGRAMS = sorted(file for file in EXAMPLES.glob("*.py") if file.name != "plot_log.py")


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda file: file.stem)
def test_an_example_runs(
    program: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(program), run_name="__main__")
    assert capsys.readouterr().out


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda file: file.stem)
def test_an_example_has_at_most_thirty_lines_of_code(program: Path) -> None:
    lines = program.read_text(encoding="utf-8").split('"""', 2)[2].strip().splitlines()
    assert len([line for line in lines if line.strip()]) <= 30
