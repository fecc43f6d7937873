"""`rt-controller` refuses what does not fit, with a message that names it and an exit code."""

import inspect
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from threading import Thread
from types import SimpleNamespace
from typing import Any

import docstring_parser
import pytest
from pydantic import BaseModel

from rt_controller import cli
from rt_controller.config import MpcSettings
from rt_controller.contract.errors import RtControllerError
from rt_controller.contract.signals import Mode
from rt_controller.driven_scenario import DrivenScenario
from rt_controller.loop import Ending
from rt_controller.safety.modes import StopCause
from rt_controller.session import ControllerSession
from rt_controller.step import StepResult
from rt_controller.terminal import run as terminal_run
from rt_controller.terminal.command_line import new_app, run_command

Run = Callable[..., tuple[int, str]]


def test_an_unknown_interface_is_refused_with_the_known_ones(run: Run) -> None:
    code, message = run("--bus", "sockketcan")
    assert code == 2
    assert "--bus 'sockketcan': expected virtual, local, socketcan" in message


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("--bus",), "--bus: expected a value, such as virtual, local, socketcan"),
        (("--bus", "virtual", "--duration-s"), "--duration-s: expected a value, found none."),
        (("--bus", "virtual", "--bus-option", "fd"), "written --bus-option.KEY VALUE, found 'fd'"),
    ],
)
def test_an_option_without_its_value_is_refused_with_how_to_write_it(
    run: Run, arguments: tuple[str, ...], expected: str
) -> None:
    code, message = run(*arguments)
    assert code == 2
    assert expected in message


def test_a_missing_network_interface_is_named(run: Run) -> None:
    code, message = run("--bus", "socketcan", "--channel", "vcan77")
    assert code == 5
    assert "vcan77" in message


@pytest.mark.parametrize("option", [("--pace", "lockstep"), ("--scenario", "straight")])
def test_options_of_the_simulated_car_need_the_virtual_bus(
    run: Run, option: tuple[str, str]
) -> None:
    code, message = run("--bus", "socketcan", *option)
    assert code == 2
    assert option[0] in message


@pytest.mark.parametrize(
    ("option", "expected"),
    [
        (("--mpc.horizon", "2"), "--mpc.horizon: expected at least 3, found '2'"),
        (("--mpc.tolerance.ey-m", "-0.1"), "--mpc.tolerance.ey-m: expected more than 0.0"),
        (("--realtime.priority", "100"), "--realtime.priority: expected at most 99"),
        (("--realtime.cpu", "99999999999999999999999"), "--realtime.cpu"),
        (("--pace", "leisurely"), "--pace"),
        (("--duration-s", "0"), "--duration-s: expected more than 0.0"),
        (("--duration-s", "inf"), "--duration-s: expected a finite number"),
        (("--wait-s", "nan"), "--wait-s: expected a finite number"),
        (("--no-such-option", "1"), "--no-such-option"),
    ],
)
def test_a_value_outside_its_range_is_refused(
    run: Run, option: tuple[str, str], expected: str
) -> None:
    code, message = run("--bus", "virtual", *option)
    assert code == 2
    assert expected in message


def test_all_refused_options_are_named_at_once(run: Run) -> None:
    code, message = run(
        *("--bus", "virtual", "--mpc.horizon", "1"),
        *("--mpc.tolerance.ey-m", "-1", "--realtime.phase-ms", "99"),
    )
    assert code == 2
    for name in ("--mpc.horizon", "--mpc.tolerance.ey-m", "--realtime.phase-ms"):
        assert name in message


def test_the_command_line_overrides_a_settings_file(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "controller.toml"
    file.write_text('bus = "sockketcan"\n[mpc]\nhorizon = 10\n')
    code, message = run("--config", file)
    assert code == 2
    assert "sockketcan" in message
    code, message = run("--config", file, "--bus", "nosuchbus")
    assert code == 2
    assert "nosuchbus" in message


def test_all_mistakes_of_a_settings_file_are_named_at_once(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "controller.toml"
    file.write_text("[mpc]\nhorizont = 10\n[mpc.tolerance]\ney_m = -3\n[realtime]\nphase_ms = 99\n")
    code, message = run("--config", file, "--bus", "socketcan")
    assert code == 2
    assert "mpc.horizont: no such setting" in message
    assert "did you mean horizon?" in message
    assert "mpc.tolerance.ey_m: expected more than 0.0, found -3" in message
    assert "realtime.phase_ms" in message


@pytest.mark.parametrize("content", [b"\xe4 = 1\n", b"mpc = [\n"])
def test_a_settings_file_that_is_not_toml_is_refused(
    run: Run, tmp_path: Path, content: bytes
) -> None:
    file = tmp_path / "controller.toml"
    file.write_bytes(content)
    code, message = run("--config", file, "--bus", "virtual")
    assert code == 2
    assert "expected a TOML file in UTF-8" in message


def test_a_missing_settings_file_is_named(run: Run, tmp_path: Path) -> None:
    code, message = run("--config", tmp_path / "nope.toml", "--bus", "virtual")
    assert code == 2
    assert "nope.toml" in message


@pytest.mark.parametrize("option", ["--json", "--ticks"])
def test_an_output_file_without_a_folder_is_refused_before_the_drive(
    run: Run, tmp_path: Path, option: str
) -> None:
    code, message = run("--bus", "virtual", option, tmp_path / "missing" / "file")
    assert code == 2
    assert option in message


class NoCar:
    """A virtual car that is never asked to drive."""

    bridge = SimpleNamespace(
        summary=lambda: SimpleNamespace(plant_failure=None),
        figures=lambda: (),
        faults_so_far=lambda: ("state_lost from 3 s",),
    )

    def tick(self, now_ns: int) -> None:
        pass

    def close(self) -> None:
        pass


def replace_car(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the simulated car by none."""
    none = DrivenScenario("none", "none", None)
    monkeypatch.setattr(terminal_run, "open_virtual_car", lambda *_: NoCar())
    monkeypatch.setattr(terminal_run, "driven_scenario", lambda _: none)
    monkeypatch.setattr(terminal_run, "steering_note", lambda *_: None)


def end_at_start(monkeypatch: pytest.MonkeyPatch, end: Callable[[ControllerSession], None]) -> None:
    """Replace the loop of each session by a thread that has ended, after a call of `end`."""

    def start(session: ControllerSession, *_: object) -> Thread:
        end(session)
        ended = Thread()
        ended.start()
        return ended

    replace_car(monkeypatch)
    monkeypatch.setattr(ControllerSession, "start", start)


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".MF4"])
def test_a_log_in_another_format_is_refused_with_the_command_that_converts(
    run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, suffix: str
) -> None:
    log = tmp_path / f"drive{suffix}"
    replace_car(monkeypatch)
    code, message = run("--bus", "virtual", "--pace", "lockstep", "--record", log)
    assert code == 2
    assert "logconvert" in message
    assert not log.exists()


@pytest.mark.parametrize(
    ("ending", "expected"),
    [(Ending.STOPPED, 0), (Ending.SAFE_STOPPED, 6), (Ending.ENDED_AT_ONCE, 130)],
)
def test_a_request_that_came_too_late_to_end_the_loop_does_not_change_the_exit_code(
    run: Run, monkeypatch: pytest.MonkeyPatch, ending: Ending, expected: int
) -> None:
    def end(session: ControllerSession) -> None:
        for _ in range(3):
            session.request_stop()
        session.record.ending = ending

    end_at_start(monkeypatch, end)
    code, message = run("--bus", "virtual", "--pace", "lockstep", "--quiet")
    assert code == expected
    assert ("ended at once" in message) == (expected == 130)
    assert message.startswith("ended before the first tick: nothing was driven\n")


def test_a_safe_stop_names_the_fault_that_the_scenario_asked_for(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def end(session: ControllerSession) -> None:
        session.record.ending = Ending.SAFE_STOPPED
        session.record.result = StepResult(mode=Mode.SAFE_STOP, cause=StopCause.STATE_LOST)

    end_at_start(monkeypatch, end)
    code, message = run("--bus", "virtual", "--pace", "lockstep")
    assert code == 6
    assert "no new vehicle state arrived in time. The scenario asked for state_lost" in message


def test_a_message_is_neither_wrapped_nor_read_as_markup(run: Run) -> None:
    path = "/tmp/[/x]/[sim]/" + 20 * "long-folder/"
    code, message = run("--bus", "virtual", "--model", path)
    assert code == 2
    assert path in message


@pytest.mark.parametrize("module", ["rt_controller.cli", "sim_bridge.cli"])
def test_help_and_version_import_neither_python_can_nor_numpy(module: str) -> None:
    program = (
        f"import sys; from {module} import main; sys.argv = ['program', '--help']\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = {'can', 'numpy', 'scipy', 'onnxruntime', 'numba'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    found = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert found.returncode == 0, found.stderr
    assert "Exit codes" in found.stdout


def test_help_has_a_usage_line_without_commands_and_reads_only_this_projects_source(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    read: list[object] = []
    getsource = inspect.getsource

    def record(found: Any) -> str:
        read.append(found)
        return getsource(found)

    monkeypatch.setattr(inspect, "getsource", record)
    monkeypatch.setattr("sys.argv", ["rt-controller", "--help"])
    parse = docstring_parser.parse_from_object
    with pytest.raises(SystemExit):
        cli.main()
    assert docstring_parser.parse_from_object is parse
    shown = capsys.readouterr().out
    assert shown.startswith("Usage: rt-controller --bus NAME [OPTIONS]\n")
    assert "double_lane_change," in shown
    assert "lateral error" in shown
    assert MpcSettings in read
    assert BaseModel not in read


def test_a_message_names_options_of_the_chosen_command_only(
    capsys: pytest.CaptureFixture[str],
) -> None:
    app = new_app("tool", "A tool.")

    @app.command
    def show(*, model: str = "") -> None:
        raise RtControllerError("Choose another `model`, or give the log's unit in `unit`.")

    with pytest.raises(SystemExit):
        run_command(app, ["show"])
    assert "another --model, or give the log's unit in `unit`." in capsys.readouterr().err


def test_python_can_is_imported_without_asammdf() -> None:
    program = "import sys, rt_controller.bus.transport; sys.exit('asammdf' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
