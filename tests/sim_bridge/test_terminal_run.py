"""`sim-bridge` at the terminal: what it says, what it closes, and its exit code."""

import gc
import json
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import Thread
from threading import enumerate as running_threads
from types import SimpleNamespace

import pytest

from rt_controller.car_figures import EXIT_LIMIT, CarFigure
from rt_controller.contract.errors import BusError
from rt_controller.terminal.stop_signals import SIGNALS
from sim_bridge import cli, terminal_run
from sim_bridge.bridge import BridgeSummary
from sim_bridge.scenario import load_scenario, parse_scenario

Run = Callable[..., tuple[int, str, str]]
NOTHING_DRIVEN = BridgeSummary(0, 20.0, 0.0, 0.0, 0.0, False, False, None)


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


class WaitingSession:
    """A session that waits, until it has received as many signals as it raises itself."""

    def __init__(self, signals: int) -> None:
        self.bridge = SimpleNamespace(
            scenario=STRAIGHT, is_waiting=True, summary=lambda: NOTHING_DRIVEN, figures=lambda: ()
        )
        self.is_stop_requested = False
        self._signals = signals

    def start(self, *_: object) -> Thread:
        for _ in range(self._signals):
            for number in SIGNALS:
                signal.raise_signal(number)
        thread = Thread()
        thread.start()
        return thread

    def request_stop(self) -> None:
        self.is_stop_requested = True

    def close(self) -> None:
        self.is_stop_requested = True


@pytest.mark.parametrize(("signals", "expected"), [(0, 5), (1, 0), (2, 0)])
def test_a_request_to_stop_while_it_waits_is_no_error_and_a_missing_controller_is_one(
    run: Run, monkeypatch: pytest.MonkeyPatch, signals: int, expected: int
) -> None:
    monkeypatch.setattr(terminal_run, "open_session", lambda *_: WaitingSession(signals))
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

    monkeypatch.setattr(terminal_run, "open_session", lambda *_: WaitingSession(1))
    monkeypatch.setattr(terminal_run, "write_figures", signal_and_write)
    assert run("--bus", "local", "--priority", "0")[0] == 0


def test_a_bus_that_does_not_open_leaves_neither_the_log_nor_the_process_changed(
    run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def fail(*_: object) -> None:
        raise BusError("no such channel")

    monkeypatch.setattr(terminal_run, "open_session", fail)
    log = tmp_path / "drive.log"
    code, _, message = run("--bus", "local", "--priority", "0", "--record", log, "--quiet")
    assert code == 5
    assert message == "sim-bridge: no such channel\n"
    assert log.exists()
    assert "recorder" not in {thread.name for thread in running_threads()}
    assert gc.isenabled()


def test_a_drive_to_its_end_that_missed_a_limit_has_its_own_exit_code(
    run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    session = WaitingSession(0)
    driven = replace(NOTHING_DRIVEN, ticks=40)
    figures = (CarFigure("ey_peak_m", 0.3, 0.2, False), CarFigure("creep_m", 0.0, None, True))
    session.bridge = SimpleNamespace(
        scenario=STRAIGHT, is_waiting=False, summary=lambda: driven, figures=lambda: figures
    )
    monkeypatch.setattr(terminal_run, "open_session", lambda *_: session)
    summary = tmp_path / "summary.json"
    code, _, message = run("--bus", "local", "--priority", "0", "--quiet", "--json", summary)
    assert code == EXIT_LIMIT == 8
    assert "found ey_peak_m missed" in message
    assert json.loads(summary.read_text())["limits_missed"] == ["ey_peak_m"]


def test_help_offers_only_interfaces_that_other_processes_reach(run: Run) -> None:
    _, shown, _ = run("--help")
    assert "socketcan" in shown
    assert "virtual" not in shown


def test_the_summary_says_that_a_drive_was_stopped_on_request(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = WaitingSession(1)
    driven = replace(NOTHING_DRIVEN, ticks=40)
    session.bridge = SimpleNamespace(
        scenario=STRAIGHT, is_waiting=False, summary=lambda: driven, figures=lambda: ()
    )
    monkeypatch.setattr(terminal_run, "open_session", lambda *_: session)
    code, out, _ = run("--bus", "local", "--priority", "0", "--quiet")
    assert code == 0
    assert "40 ticks" in out
    assert "stopped on request before the end" in out


def test_a_scenario_that_needs_too_much_steering_has_a_note_at_the_start(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = {
        "format": 2, "name": "tight", "duration_s": 5.0, "road": {"curvature_per_m": 0.025},
        "reference": {"speed_kmh": 25.0},
    }  # fmt: skip
    session = WaitingSession(1)
    session.bridge.scenario = parse_scenario(content, "test")
    monkeypatch.setattr(terminal_run, "open_session", lambda *_: session)
    _, _, message = run("--bus", "local", "--priority", "0")
    assert "note: scenario 'tight': a steady state needs about 80 deg" in message
