"""`sim-bridge` at the terminal: what it says, what it closes, and its exit code."""

import gc
import json
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import Event, Thread
from threading import enumerate as running_threads
from types import SimpleNamespace

import pytest

from rt_controller.contract.errors import BusError
from rt_controller.drive.car_figures import EXIT_LIMIT, CarFigure
from rt_controller.terminal.stop_signals import SIGNALS
from sim_bridge import cli, terminal_run
from sim_bridge.bridge_summary import BridgeSummary
from sim_bridge.scenario import load_scenario, parse_scenario

Run = Callable[..., tuple[int, str, str]]
NOTHING_DRIVEN = BridgeSummary(0, 20.0, 0.0, 0.0, 0.0, False, False, {}, 0, {}, None)


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Call the program in this process; its exit code, stdout and stderr."""

    def call(*arguments: str | Path) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["sim-bridge", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        shown = capsys.readouterr()
        return int(ended.value.code or 0), shown.out, shown.err

    return call


STRAIGHT = load_scenario("straight")


def _bridge(
    summary: BridgeSummary, figures: tuple[CarFigure, ...] = (), is_waiting: bool = False
) -> SimpleNamespace:
    return SimpleNamespace(
        scenario=STRAIGHT,
        is_waiting=is_waiting,
        summary=lambda: summary,
        figures=lambda: figures,
        require_readable_bus=lambda: None,
    )


class WaitingSession:
    """A session that waits, until it has received as many signals as it raises itself."""

    def __init__(self, signals: int) -> None:
        self.bridge = _bridge(NOTHING_DRIVEN, is_waiting=True)
        self.is_stop_requested = False
        self._signals = signals
        self._requested = Event()

    def start(self, *_: object) -> Thread:
        for _ in range(self._signals):
            for number in SIGNALS:
                signal.raise_signal(number)
        # Signals are passed on in a thread of their own.
        patience_s = 30.0 if self._signals else 0.0
        thread = Thread(target=self._requested.wait, args=(patience_s,))
        thread.start()
        return thread

    def request_stop(self) -> None:
        self.is_stop_requested = True
        self._requested.set()

    def close(self) -> None:
        self.is_stop_requested = True


@pytest.mark.parametrize(("signals", "expected"), [(0, 5), (1, 0), (2, 0)])
def test_a_request_to_stop_while_it_waits_is_no_error_and_a_missing_controller_is_one(
    run: Run, monkeypatch: pytest.MonkeyPatch, signals: int, expected: int
) -> None:
    monkeypatch.setattr(terminal_run, "open_session", lambda *_, **__: WaitingSession(signals))
    code, out, message = run("--bus", "local", "--priority", "0", "--quiet")
    assert code == expected
    nothing_driven = "ended before a controller took the car: nothing was driven\n"
    assert out == (nothing_driven if expected == 0 else "")
    assert message == "" or expected == 5


def test_signals_while_the_summary_is_written_change_nothing(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def signal_and_write(*_: object) -> None:
        for number in SIGNALS:
            signal.raise_signal(number)
            signal.raise_signal(number)

    monkeypatch.setattr(terminal_run, "open_session", lambda *_, **__: WaitingSession(1))
    monkeypatch.setattr(terminal_run, "write_figures", signal_and_write)
    assert run("--bus", "local", "--priority", "0")[0] == 0


def test_a_bus_that_does_not_open_leaves_neither_the_log_nor_the_process_changed(
    run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise BusError("no such channel")

    monkeypatch.setattr(terminal_run, "open_session", fail)
    log = tmp_path / "drive.log"
    code, _, message = run("--bus", "local", "--priority", "0", "--record", log, "--quiet")
    assert code == 5
    assert message == "sim-bridge: no such channel\n"
    assert not log.exists()
    assert "recorder" not in {thread.name for thread in running_threads()}
    assert gc.isenabled()


def test_a_drive_to_its_end_that_missed_a_limit_has_its_own_exit_code(
    run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    session = WaitingSession(0)
    driven = replace(NOTHING_DRIVEN, ticks=40)
    figures = (CarFigure("ey_peak_m", 0.3, 0.2, False), CarFigure("creep_m", 0.0, None, True))
    session.bridge = _bridge(driven, figures)
    monkeypatch.setattr(terminal_run, "open_session", lambda *_, **__: session)
    summary = tmp_path / "summary.json"
    code, _, message = run("--bus", "local", "--priority", "0", "--quiet", "--json", summary)
    assert code == EXIT_LIMIT == 8
    assert "found ey_peak_m missed" in message
    assert json.loads(summary.read_text())["limits_missed"] == ["ey_peak_m"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
@pytest.mark.parametrize(("ticks", "expected"), [(0, 5), (40, 9)])
def test_a_summary_that_cannot_be_written_hides_no_other_failure(
    run: Run, monkeypatch: pytest.MonkeyPatch, ticks: int, expected: int
) -> None:
    session = WaitingSession(0)
    summary = replace(NOTHING_DRIVEN, ticks=ticks)
    session.bridge = _bridge(summary)
    monkeypatch.setattr(terminal_run, "open_session", lambda *_, **__: session)
    options = ("--bus", "local", "--priority", "0", "--quiet", "--json", "/dev/full")
    code, _, message = run(*options)
    assert code == expected
    assert "--json /dev/full: expected room for the figures" in message


def test_a_bus_that_failed_in_the_drive_is_named_after_the_summary(
    run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def fail() -> None:
        raise BusError("unplugged")

    session = WaitingSession(0)
    session.bridge = _bridge(replace(NOTHING_DRIVEN, ticks=40, watchdog_braked=True))
    session.bridge.require_readable_bus = fail
    monkeypatch.setattr(terminal_run, "open_session", lambda *_, **__: session)
    summary = tmp_path / "summary.json"
    code, out, message = run("--bus", "local", "--priority", "0", "--quiet", "--json", summary)
    assert code == 5
    assert "BRAKED BY THE WATCHDOG" in out
    assert "unplugged" in message
    assert json.loads(summary.read_text())["watchdog_braked"]


@pytest.mark.parametrize(
    ("cause", "failed", "expected"),
    [
        ("NO_COMMAND", (), "the controller stopped sending"),
        ("NO_COMMAND", ("THROTTLE",), "stopped sending. Besides, the throttle stays open."),
        ("LEAVING_PATH", (), "within 0.9 m of its path (0.5 m in a safe stop), found that the car"),
        ("LEAVING_PATH", ("STEERING_WHEEL",), "leave its path; the steering wheel does not move."),
        ("ACTUATOR_FAILED", ("STEERING_WHEEL",), "found that the steering wheel does not move."),
    ],
)
def test_the_cause_of_the_braking_is_in_the_message_and_in_the_summary(
    run: Run,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    cause: str,
    failed: tuple[str, ...],
    expected: str,
) -> None:
    session = WaitingSession(0)
    driven = replace(NOTHING_DRIVEN, ticks=40, watchdog_braked=True)
    summary = replace(driven, braking_cause=cause, failed_actuators=failed)
    session.bridge = _bridge(summary)
    monkeypatch.setattr(terminal_run, "open_session", lambda *_, **__: session)
    file = tmp_path / "summary.json"
    code, out, message = run("--bus", "local", "--priority", "0", "--quiet", "--json", file)
    assert code == 5
    assert expected in message
    assert ("stopped sending" in message) is (cause == "NO_COMMAND")
    assert f"BRAKED BY THE WATCHDOG: {summary.braking_text}" in out
    written = json.loads(file.read_text())
    assert (written["braking_cause"], written["failed_actuators"]) == (cause, list(failed))


@pytest.mark.parametrize(
    ("released", "speed_mps", "is_said"),
    [(True, 100.0 / 3.6, True), (True, 0.2, False), (False, 100.0 / 3.6, False)],
)
def test_a_moving_car_that_was_released_is_said_with_its_speed(
    run: Run, monkeypatch: pytest.MonkeyPatch, released: bool, speed_mps: float, is_said: bool
) -> None:
    session = WaitingSession(1)
    summary = replace(NOTHING_DRIVEN, ticks=40, released=released, final_speed_mps=speed_mps)
    session.bridge = _bridge(summary)
    monkeypatch.setattr(terminal_run, "open_session", lambda *_, **__: session)
    _, out, _ = run("--bus", "local", "--priority", "0", "--quiet")
    assert ("released at 100 km/h" in out) is is_said


def test_figures_of_the_scenario_have_a_heading(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    session = WaitingSession(1)
    figures = (CarFigure("ey_peak_m", 0.3, 0.5, True),)
    session.bridge = _bridge(replace(NOTHING_DRIVEN, ticks=40), figures)
    monkeypatch.setattr(terminal_run, "open_session", lambda *_, **__: session)
    _, out, _ = run("--bus", "local", "--priority", "0", "--quiet")
    assert out.index("figures of the scenario") < out.index("ey_peak_m   0.3 (limit 0.5)")


def test_help_offers_only_interfaces_that_other_processes_reach(run: Run) -> None:
    _, shown, _ = run("--help")
    assert "socketcan" in shown
    assert "virtual" not in shown


def test_the_summary_says_that_a_drive_was_stopped_on_request(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = WaitingSession(1)
    driven = replace(NOTHING_DRIVEN, ticks=40)
    session.bridge = _bridge(driven)
    monkeypatch.setattr(terminal_run, "open_session", lambda *_, **__: session)
    code, out, _ = run("--bus", "local", "--priority", "0", "--quiet")
    assert code == 0
    assert "40 ticks" in out
    assert "stopped on request before the end" in out


def test_a_scenario_that_needs_too_much_steering_has_a_note_at_the_start(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = {
        "format": 2, "name": "tight", "duration_s": 5.0, "road": {"curvature_per_m": 0.025},
        "reference": {"speed_kmh": 40.0},
    }  # fmt: skip
    session = WaitingSession(1)
    session.bridge.scenario = parse_scenario(content, "test")
    monkeypatch.setattr(terminal_run, "open_session", lambda *_, **__: session)
    _, _, message = run("--bus", "local", "--priority", "0")
    assert "note: scenario 'tight': a steady state needs about 85 deg" in message
