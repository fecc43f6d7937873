"""Numbers that a command's own options refuse, with the option as it was written."""

import pytest

import rt_controller.cli
import sim_bridge.cli
from rt_controller.terminal.command_line import run_command

CHECK = ("signals", "check", "car.toml", "--bus", "local")
GATEWAY = ("signals", "gateway", "car.toml", "--bus", "local", "--car-bus", "local")
MATRIX = ("fault-matrix", "--only", "state_lost")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ((*CHECK, "--listen-s=nan"), "--listen-s: expected a finite number, found nan."),
        ((*CHECK, "--listen-s=inf"), "--listen-s: expected a finite number, found inf."),
        ((*CHECK, "--listen-s=-1"), "--listen-s: expected more than 0.0, found -1.0."),
        ((*CHECK, "--bitrate=-5"), "--bitrate: expected more than 0, found -5."),
        (
            (*GATEWAY, "--car-channel", "car", "--car-bitrate=0"),
            "--car-bitrate: expected more than 0, found 0.",
        ),
        (("explain", "run.log", "--tick=-1"), "--tick: expected at least 0, found -1."),
        ((*MATRIX, "--jobs=0"), "--jobs: expected at least 1, found 0."),
        ((*MATRIX, "--speed-kmh", "60", "nan"), "--speed-kmh[1]: expected a finite number"),
    ],
)
def test_a_number_that_makes_no_sense_is_refused_with_its_option(
    arguments: tuple[str, ...], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    app = (sim_bridge if arguments[0] == "fault-matrix" else rt_controller).cli.app
    with pytest.raises(SystemExit) as ended:
        run_command(app, arguments)
    assert ended.value.code == 2
    assert expected in capsys.readouterr().err
