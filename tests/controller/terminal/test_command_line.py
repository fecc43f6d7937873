"""`rt-controller` refuses what does not fit, with a message that names it and an exit code."""

from collections.abc import Callable
from pathlib import Path
from threading import Thread
from types import SimpleNamespace

import pytest

from rt_controller.contract.errors import RtControllerError
from rt_controller.contract.faults import StopCause
from rt_controller.contract.signals import Mode
from rt_controller.drive.scenario import DrivenScenario
from rt_controller.loop import Ending
from rt_controller.safety.tick import Tick
from rt_controller.session import ControllerSession
from rt_controller.terminal import run as terminal_run
from rt_controller.terminal.command_line import new_app, run_command
from rt_controller.terminal.entry import INTERRUPTED
from rt_controller.terminal.stop_message import VEHICLE_KNOWS

Run = Callable[..., tuple[int, str]]
LINKED = ("--json", "--ticks", "--plot", "--record")
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
        ("--bus virtual --mpc.horizon 2", "--mpc.horizon: expected at least 3, found '2'"),
        ("--bus virtual --mpc.tolerance.ey-m=-0.1", "--mpc.tolerance.ey-m: expected at least"),
        ("--bus virtual --realtime.priority 100", "--realtime.priority: expected at most 99"),
        ("--bus virtual --realtime.cpu 99999999999999999999999", "--realtime.cpu"),
        ("--bus virtual --pace leisurely", "--pace"),
        ("--bus virtual --duration-s 0", "--duration-s: expected more than 0.0"),
        ("--bus virtual --duration-s inf", "--duration-s: expected a finite number"),
        ("--bus virtual --no-such-option 1", "--no-such-option"),
        (
            "--bus virtual --mpc.horizon 1 --realtime.phase-ms 99",
            "--mpc.horizon: expected at least 3, found '1'.\n--realtime.phase-ms: expected less",
        ),
        (f"--bus virtual --model {LONG}", LONG),  # neither wrapped nor read as markup
        (
            "--bus virtual --record drive.log --json folder/../drive.log",
            "expected a file of its own, found that of --record",
        ),
        ("--bus virtual --model run", "a run: its bundle is run/bundle."),
        ("--bus virtual --model folder", "export it first: offline-export folder."),
        ("--bus virtual --json missing/file", "--json missing/file: expected a file"),
        ("--bus virtual --ticks missing/file", "--ticks missing/file: expected a file"),
        ("--bus virtual --record drive.trc", "can_logconvert"),
        *((f"--bus virtual {each} loop.svg", "symbolic links") for each in LINKED),
    ],
)
def test_what_does_not_fit_is_refused_before_the_drive_with_what_was_expected(
    run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, arguments: str, expected: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run" / "bundle").mkdir(parents=True)
    (tmp_path / "folder").mkdir()
    for run_folder in ("run", "folder"):
        (tmp_path / run_folder / "config.json").touch()
    (tmp_path / "loop.svg").symlink_to("loop.svg")
    code, message = run(*arguments.split())
    assert code == 2
    assert expected in message
    assert not list(tmp_path.glob("drive*"))


def test_a_missing_network_interface_is_named(run: Run) -> None:
    code, message = run("--bus", "socketcan", "--channel", "vcan77")
    assert code == 5
    assert "vcan77" in message


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

    def close(self) -> None:
        pass


def replace_car(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the simulated car by none."""
    none = DrivenScenario("none", "none", None)
    monkeypatch.setattr(terminal_run, "open_virtual_car", lambda *_, **__: NoCar())
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
    assert ("ended at once at an unknown speed" in message) == (expected == 130)


@pytest.mark.parametrize("has_ended", [False, True])
def test_a_requested_stop_in_which_the_vehicle_braked_by_itself_names_its_cause(
    run: Run, monkeypatch: pytest.MonkeyPatch, has_ended: bool
) -> None:
    def end(session: ControllerSession) -> None:
        session.record.ending = Ending.STOPPED

    end_at_start(monkeypatch, end)
    summary = NoCar.bridge.summary()
    summary.braking_cause = "LEAVING_PATH"
    summary.braking_text = "the car was about to leave its path"
    summary.controller_ended = has_ended  # the car stands, nothing is wrong
    monkeypatch.setattr(NoCar.bridge, "summary", lambda: summary)
    code, message = run("--bus", "virtual", "--pace", "lockstep", "--quiet")
    cause = "stopped on request; the vehicle then braked by itself: the car was about to leave"
    assert (code, cause in message) == ((0, False) if has_ended else (6, True))


def test_a_requested_stop_names_the_braking_that_only_the_vehicle_can_explain(
    run: Run, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    def end(session: ControllerSession) -> None:
        session.record.ending = Ending.STOPPED
        braking = SimpleNamespace(content=SimpleNamespace(is_watchdog_braking=True))
        monkeypatch.setattr(session.inbox, "newest", lambda _: braking)

    end_at_start(monkeypatch, end)
    code, message = run(
        "--bus", "local", "--channel", request.node.name[:20], "--model-trial", "off"
    )
    assert code == 6
    assert f"the vehicle then braked by itself. {VEHICLE_KNOWS}" in message


def test_a_safe_stop_names_the_fault_of_the_scenario(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def end(session: ControllerSession) -> None:
        session.record.ending = Ending.SAFE_STOPPED
        session.record.result = Tick(mode=Mode.SAFE_STOP, cause=StopCause.STATE_LOST)

    end_at_start(monkeypatch, end)
    code, message = run("--bus", "virtual", "--pace", "lockstep")
    assert code == 6
    assert "no new vehicle state arrived in time. Faults of this drive: state_lost" in message


@pytest.mark.parametrize("ending", [Ending.SAFE_STOPPED, Ending.STOPPED])
def test_a_bus_that_failed_in_a_stop_that_began_for_another_reason_gives_its_exit_code(
    run: Run, monkeypatch: pytest.MonkeyPatch, ending: Ending
) -> None:
    def end(session: ControllerSession) -> None:
        session.record.ending = ending
        session.record.result = Tick(
            mode=Mode.SAFE_STOP, cause=StopCause.STATE_LOST, bus_fault=StopCause.BUS_FAILED
        )

    end_at_start(monkeypatch, end)
    code, message = run("--bus", "virtual", "--pace", "lockstep")
    assert code == 5
    assert "then: the bus cannot be read" in message


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


@pytest.mark.parametrize("has_meta", [False, True])
def test_a_command_that_is_interrupted_ends_with_one_line_and_its_code(
    has_meta: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    app = new_app("program", "A program.", "--option")

    @app.default
    def work() -> None:
        raise KeyboardInterrupt

    if has_meta:

        @app.meta.default
        def with_more() -> int:
            app([], exit_on_error=False, print_error=False, result_action="return_value")
            return 0

    with pytest.raises(SystemExit) as ended:
        run_command(app, [])
    assert ended.value.code == INTERRUPTED
    assert capsys.readouterr().err == "program: ended by Ctrl-C\n"
