"""`rt-controller` refuses what does not fit, with a message that names it and an exit code."""

import os
import pkgutil
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from threading import Thread
from types import SimpleNamespace

import pytest

from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.faults import Fault, StopCause
from rt_controller.contract.signals import Mode
from rt_controller.drive.scenario import DrivenScenario
from rt_controller.loop import Ending
from rt_controller.model.artifact import find_model
from rt_controller.safety.tick import Tick
from rt_controller.session import ControllerSession
from rt_controller.terminal import run as terminal_run
from rt_controller.terminal.stop_message import VEHICLE_KNOWS

LINKED = ("--json", "--ticks", "--plot")
LONG = "/tmp/[/x]/[sim]/" + 20 * "long-folder/"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ("--bus sockketcan", "--bus 'sockketcan': expected virtual, local, socketcan"),
        ("--bus", "--bus: expected a value, such as virtual, local, socketcan"),
        ("--bus virtual --duration-s", "--duration-s: expected a value, found none."),
        ("--bus virtual --bus-option fd", "written --bus-option.KEY VALUE, found 'fd'"),
        ("--bus socketcan --pace lockstep", "--pace lockstep: expected --bus virtual"),
        ("--bus socketcan --scenario straight", "--scenario: expected --bus virtual"),
        ("explain run.log --tick=-1", "--tick: expected at least 0, found -1."),
        ("signals check car.toml --bus local --listen-s=nan", "--listen-s: expected a finite"),
        ("signals check car.toml --bus local --bitrate=-5", "--bitrate: expected more than 0"),
        ("--bus virtual --mpc.tolerance.ey-m=-0.1", "--mpc.tolerance.ey-m: expected at least"),
        ("--bus virtual --realtime.cpu 99999999999999999999999", "--realtime.cpu"),
        ("--bus virtual --pace leisurely", "--pace"),
        ("--bus virtual --duration-s 0", "--duration-s: expected more than 0.0"),
        ("--bus virtual --no-such-option 1", "--no-such-option"),
        ("--bus virtual --modle lti", "--modle: no such option (did you mean --model?)"),
        ("replya drive.log", "'replya' is neither an option nor a command (did you mean replay?)"),
        ("--bus virtual strange", "'strange' is neither an option nor a command. --help"),
        ("--bus local --channel refused --model empty", "koopman.npz"),
        (f"--bus virtual --model {LONG}", LONG),  # neither wrapped nor read as markup
        ("--bus virtual --record drive.log --json folder/../drive.log", "found that of --record"),
        ("--bus virtual --model run", "a run: its bundle is run/bundle."),
        ("--bus virtual --model folder", "export it first: offline-export folder."),
        ("--bus virtual --json missing/file", "--json missing/file: expected a file"),
        ("--bus virtual --ticks missing/file", "--ticks missing/file: expected a file"),
        ("--bus virtual --record drive.trc", "can_logconvert"),
        ("--bus virtual --plot drive.doc", "drive.doc: expected a figure as one of"),
        ("--bus virtual --json file/x", "--json file/x: expected a file"),
        ("replay log.log --json log.log", "--json log.log: expected a file that can be written"),
        ("replay log.log --mcap drive.txt", "--mcap drive.txt: expected a file name that ends in"),
        ("replay log.log --mcap missing/drive.mcap", "found no folder missing"),
        ("explain log.log --json log.log", "found a file that this command reads"),
        ("report log.log --output drive.pdf", "--output drive.pdf: expected a file name that ends"),
        ("report log.log --json log.log", "found a file that this command reads"),
        ("signals check log.log log.log --json log.log", "found a file that this command reads"),
        ("compare stanley --html drive.pdf", "--html drive.pdf: expected a file name that ends in"),
        ("compare stanley --plot drive.doc", "drive.doc: expected a figure as one of"),
        ("compare stanley --results file/x", "--results file/x: expected a file"),
        *((f"--bus virtual {each} loop.svg", "symbolic links") for each in LINKED),
    ],
)
def test_what_does_not_fit_is_refused_before_the_drive_with_what_was_expected(
    run, monkeypatch, tmp_path, arguments, expected
):
    if arguments.startswith(("report", "compare")):  # which a missing extra refuses first
        pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run" / "bundle").mkdir(parents=True)
    for name in ("folder", "empty"):
        (tmp_path / name).mkdir()
    for run_folder in ("run", "folder"):
        (tmp_path / run_folder / "config.json").touch()
    (tmp_path / "loop.svg").symlink_to("loop.svg")
    for name in ("file", "log.log"):
        (tmp_path / name).touch()
    code, message = run(*arguments.split())
    assert code == 2
    assert expected in message
    assert not list(tmp_path.glob("drive*"))


def test_a_missing_network_interface_is_named_before_the_model_is_loaded(run, tmp_path):
    code, message = run("--bus", "socketcan", "--channel", "vcan77", "--model", tmp_path)
    assert code == 5
    assert "vcan77" in message


@pytest.mark.parametrize(
    ("arguments", "environment", "expected"),
    [
        ("--bus", {}, "rt-controller: --bus: expected"),
        ("--bus", {"FORCE_COLOR": "1"}, "\x1b[31mrt-controller: --bus: expected"),
        ("--bus", {"FORCE_COLOR": "1", "NO_COLOR": "1"}, "rt-controller: --bus: expected"),
        ("--bus", {"FORCE_COLOR": "1", "TERM": "dumb"}, "rt-controller: --bus: expected"),
        ("--bus virtual --check --model lti", {}, "loading the model, assembling the QP\n"),
    ],
)
def test_stderr_begins_with_a_message_of_the_program(arguments, environment, expected):
    """In colour only where that is wanted; python-can says nothing of its own."""
    colours = ("FORCE_COLOR", "NO_COLOR", "TERM")
    inherited = {name: value for name, value in os.environ.items() if name not in colours}
    command = [sys.executable, "-m", "rt_controller", *arguments.split()]
    done = subprocess.run(
        command, env={**inherited, **environment}, capture_output=True, text=True, check=False
    )
    assert done.stderr.startswith(expected)


class NoCar:
    """A virtual car that is never asked to drive."""

    bridge = SimpleNamespace(
        summary=lambda: SimpleNamespace(
            plant_failure=None,
            ey_rms_m=0.0,
            ey_peak_m=0.0,
            controller_ended=False,
            braking_cause=None,
            braking_text="",
        ),
        figures=lambda: (),
        faults_so_far=lambda: ("state_lost from 3 s",),
    )

    def tick(self, now_ns: int) -> None:
        pass

    def start(self, priority: int) -> None:
        pass

    def close(self) -> None:
        pass


def replace_car(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the simulated car by none."""
    none = DrivenScenario("none", "none", None)
    monkeypatch.setattr(terminal_run, "open_virtual_car", lambda *_, **__: NoCar())
    monkeypatch.setattr(terminal_run, "driven_scenario", lambda _: none)
    monkeypatch.setattr(terminal_run, "scenario_notes", lambda *_: ())


def end_at_start(monkeypatch: pytest.MonkeyPatch, end: Callable[[ControllerSession], None]) -> None:
    """Replace the loop of each session by a thread that has ended, after a call of `end`."""

    def start(session: ControllerSession, *_: object) -> Thread:
        end(session)
        ended = Thread()
        ended.start()
        return ended

    replace_car(monkeypatch)
    monkeypatch.setattr(ControllerSession, "start", start)


def fail_a_bus(session: ControllerSession) -> None:
    session.record.result = Tick(
        mode=Mode.SAFE_STOP, cause=StopCause.STATE_LOST, bus_fault=StopCause.BUS_FAILED
    )


def lose_the_state(session: ControllerSession) -> None:
    session.record.result = Tick(mode=Mode.SAFE_STOP, cause=StopCause.STATE_LOST)


def request_thrice(session: ControllerSession) -> None:
    for _ in range(3):
        session.request_stop()  # too late to end the loop


def brake_alone(session: ControllerSession) -> None:
    braking = SimpleNamespace(content=SimpleNamespace(is_watchdog_braking=True))
    session.inbox.newest = lambda _: braking


@pytest.mark.parametrize(
    ("ending", "happen", "bus", "code", "expected"),
    [
        (Ending.STOPPED, request_thrice, "virtual", 0, ""),
        (Ending.SAFE_STOPPED, request_thrice, "virtual", 6, "Faults of this drive: state_lost"),
        (Ending.ENDED_AT_ONCE, request_thrice, "virtual", 130, "ended at once at an unknown speed"),
        (Ending.SAFE_STOPPED, lose_the_state, "virtual", 6, "state arrived in time. Fau"),
        (Ending.SAFE_STOPPED, fail_a_bus, "virtual", 5, "then: the bus cannot be read"),
        (Ending.STOPPED, fail_a_bus, "virtual", 5, "then: the bus cannot be read"),
        (Ending.STOPPED, brake_alone, "local", 6, f"then braked by itself. {VEHICLE_KNOWS}"),
    ],
)
def test_the_exit_code_and_the_message_say_how_a_drive_ended(
    run, monkeypatch, tmp_path, ending, happen, bus, code, expected
):
    def end(session):
        happen(session)
        session.record.ending = ending

    end_at_start(monkeypatch, end)
    pace = ("--pace", "lockstep") if bus == "virtual" else ("--channel", tmp_path.name[-20:])
    found, message = run("--bus", bus, *pace, "--quiet")
    assert found == code
    assert expected in message


@pytest.mark.parametrize(
    ("cause", "expected"),
    [
        (
            StopCause.STATE_LOST,
            "^rt-controller: this machine was too busy .* stopped at 0.0 s; --p",
        ),
        (
            StopCause.PATH_JUMP,
            r"^rt-controller: safe stop: the path jumps\..* Besides, this machin",
        ),
    ],
)
def test_a_busy_machine_is_named_after_a_cause_that_has_nothing_to_do_with_it(
    run, monkeypatch, cause, expected
):
    def end(session):
        session.record.ticks_by_fault[Fault.STATE_STALE] = 50
        session.record.result = Tick(mode=Mode.SAFE_STOP, cause=cause)
        session.record.ending = Ending.SAFE_STOPPED

    end_at_start(monkeypatch, end)
    monkeypatch.setattr(NoCar.bridge, "faults_so_far", lambda: ())
    code, message = run("--bus", "virtual", "--quiet")
    assert code == 6
    assert re.search(expected, message), message


def test_all_names_and_ranges_are_refused_in_one_message_before_anything_is_loaded(
    run, monkeypatch
):
    monkeypatch.setattr(terminal_run, "load_bundle", None)
    wrong = {
        "--model": "lit",
        "--scenario": "strait",
        "--car": "none.toml",
        "--friction": "7",
        "--plant": "mine",
        "--mpc.horizon": "2",
        "--realtime.phase-ms": "99",
    }
    code, message = run("--bus", "virtual", *(part for item in wrong.items() for part in item))
    assert code == 2
    for option, value in wrong.items():
        assert re.search(f"{option}: expected .*, found '{value}'", message), option
    assert "(did you mean straight?)" in message


def test_a_path_is_never_taken_for_a_shipped_name(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ArtifactError, match=r"'\./lti'.*\(did you mean lti\?\)"):
        find_model("./lti")
    for folder in ("./lti", "runs/lti"):
        Path(folder).mkdir(parents=True)
        assert find_model(folder) == Path(folder)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b'bus = "sockketcan"', "--bus 'nosuchbus'"),  # the command line comes first
        (
            b"[mpc]\nhorizont = 10\n[mpc.tolerance]\ney_m = -3\n[realtime]\nphase_ms = 99\n",
            r"mpc.tolerance.ey_m: expected at least 1e-06, found -3.\n"
            r"mpc.horizont: no such setting \(did you mean horizon\?\).\nrealtime.phase_ms: ",
        ),
        (b"\xe4 = 1\n", "expected a TOML file in UTF-8"),
        (b"a = " + b"[" * 20_000, "expected a TOML file in UTF-8"),
        (None, "expected a TOML file, found Not a regular file"),
    ],
)
def test_every_mistake_of_a_settings_file_is_named(run, tmp_path, content, expected):
    file = tmp_path / "controller.toml"
    if content is None:
        os.mkfifo(file)
    else:
        file.write_bytes(content)
    code, message = run("--config", file, "--bus", "nosuchbus")
    assert code == 2
    assert re.search(expected, message)


@pytest.mark.parametrize("module", ["rt_controller.cli", "sim_bridge.cli"])
def test_help_and_version_import_neither_python_can_nor_numpy(module):
    program = (
        f"import sys; from {module} import main; sys.argv = ['program', '--help']\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = {'can', 'numpy', 'scipy', 'onnxruntime'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    found = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert found.returncode == 0, found.stderr
    assert "Exit codes" in found.stdout


@pytest.mark.parametrize(
    ("program", "arguments", "shown", "hidden"),
    [
        ("rt_controller.cli.main", "--help", "--scenario", "--mpc.horizon"),
        ("rt_controller.cli.main", "--help-all", "--mpc.tolerance.ey-m", "All options:"),
        ("rt_controller.cli.main", "replay --help", "--mcap", "All options:"),
        ("sim_bridge.cli.main", "--help", "--signals", "--friction-right"),
        ("offline.commands.train.main", "--help", "--steps", "--bilinear-rank"),
        ("offline.commands.evaluate.main", "--help", "--baselines", "All options:"),
    ],
)
def test_help_shows_the_main_options_and_help_all_every_one_in_groups(
    monkeypatch, capsys, program, arguments, shown, hidden
):
    monkeypatch.setattr("sys.argv", ["program", *arguments.split()])
    with pytest.raises(SystemExit) as ended:
        pkgutil.resolve_name(program)()
    text = capsys.readouterr().out
    assert ended.value.code == 0
    assert text.startswith("Usage: ")
    assert shown in text
    assert hidden not in text
    options = re.findall(r"^│ [* ]*--", text.partition("─ Commands ─")[2].partition("╰")[2], re.M)
    assert "--help-all" in arguments or len(options) <= 13
