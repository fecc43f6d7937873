"""Every example is short and runs as it is written."""

import runpy
from pathlib import Path

import pytest

import offline.commands.data
import offline.commands.export
import rt_controller.cli

EXAMPLES = Path(__file__).parents[2] / "examples"
PROGRAMS = sorted(EXAMPLES.glob("*.py"))
ARGUMENTS = {
    "controller_fmu": ("law.fmu",),
    "plot_log": ("drive.svg", "drive.log"),
    "reinforcement_learning": ("1",),
}
PACKAGES = {"reinforcement_learning": "stable_baselines3"}
"""that no extra has: without it the example is left out"""
PREPARATIONS = {
    "controller_fmu": (offline.commands.export.main, "--target fmu --output law.fmu"),
    "own_encoder": (
        offline.commands.data.main,
        "--episodes 20 --seed 1 --largest-steer-deg 40 --data small --jobs 1",
    ),
    "own_predictor": (offline.commands.data.main, "--episodes 10 --seed 1 --data small --jobs 1"),
    "plot_log": (
        rt_controller.cli.main,
        "--bus virtual --pace lockstep --quiet --scenario straight --model lti --record drive.log",
    ),
}


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda file: file.stem)
def test_an_example_runs(
    program: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if program.stem in PACKAGES:
        pytest.importorskip(PACKAGES[program.stem])
    monkeypatch.chdir(tmp_path)
    if program.stem in PREPARATIONS:
        command, options = PREPARATIONS[program.stem]
        monkeypatch.setattr("sys.argv", ["prepare", *options.split()])
        with pytest.raises(SystemExit) as ended:
            command()
        assert not ended.value.code
        capsys.readouterr()
    monkeypatch.setattr("sys.argv", [str(program), *ARGUMENTS.get(program.stem, ())])
    runpy.run_path(str(program), run_name="__main__")
    assert capsys.readouterr().out


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda file: file.stem)
def test_an_example_has_at_most_thirty_lines_of_code(program: Path) -> None:
    lines = program.read_text(encoding="utf-8").split('"""', 2)[2].strip().splitlines()
    assert len([line for line in lines if line.strip()]) <= 30
