"""`rt-controller signals check` at the terminal."""

import json
from pathlib import Path

import can
import pytest
from own_car import EXAMPLE, VALUES, example, state_writer

import rt_controller.cli
from rt_controller.terminal.command_line import run_command

STRAIGHT = {"inputs.steer_rad": 0.0, "states.yaw_rate_radps": 0.0}


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        run_command(rt_controller.cli.app, arguments)
    code = ended.value.code
    assert isinstance(code, int)
    return code


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Of a car that goes straight, with a gap of 0.6 s and an angle of -0."""
    writer, file = state_writer(example()), tmp_path / "drive.log"
    with can.Logger(file) as logger:
        for tick in [*range(100), *range(124, 200)]:
            for frame in writer.frames(VALUES | STRAIGHT, tick):
                frame.timestamp = 1000.0 + 0.025 * tick
                logger(frame)
    return file


def test_a_gap_of_a_message_is_explained_once_and_what_was_not_compared_is_said(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("signals", "check", str(EXAMPLE), str(log), "--json", str(tmp_path / "f.json")) == 8
    shown = " ".join(capsys.readouterr().out.split())
    assert "not compared: too little motion" in shown
    assert "same as" in shown
    assert " -0 " not in shown
    figures = json.loads((tmp_path / "f.json").read_text())
    absent = "commands.steer_rad = wheel angle of the yaw rate (no samples of commands.steer_rad)"
    assert absent in figures["not_compared"]
    gaps = [each for each in figures["signals"] if each["problem"].startswith("a gap of")]
    messages = {each["message"] for each in gaps}
    assert shown.count("a gap of") == len(messages) < len(gaps)


def test_a_quiet_check_shows_no_progress(capsys: pytest.CaptureFixture[str]) -> None:
    options = ("--bus", "virtual", "--channel", "quiet", "--listen-s", "0.01")
    assert run("signals", "check", str(EXAMPLE), *options) == 8
    assert "listening for" in capsys.readouterr().err
    assert run("signals", "check", str(EXAMPLE), *options, "--quiet") == 8
    assert capsys.readouterr().err == ""
