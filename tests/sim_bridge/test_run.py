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
from typing import Any

import pytest

from rt_controller.contract.errors import BusError
from rt_controller.drive.scenario import EXIT_LIMIT, CarFigure
from rt_controller.terminal.stop_signals import SIGNALS
from sim_bridge import cli
from sim_bridge import run as terminal
from sim_bridge.bridge import BridgeSummary
from sim_bridge.scenario import load_scenario, parse_scenario

Run = Callable[..., tuple[int, str, str]]
NOTHING_DRIVEN = BridgeSummary(0, 20.0, 0.0, 0.0, 0.0, False, False, {}, 0, {}, None)
DRIVEN = replace(NOTHING_DRIVEN, ticks=40)
BRAKED = replace(DRIVEN, watchdog_braked=True)


class Session:
    """A session that waits until it has received the signals that it raises itself."""

    def __init__(self, signals: int, summary: BridgeSummary, **bridge: Any) -> None:
        self.bridge = SimpleNamespace(
            scenario=load_scenario("straight"),
            is_waiting=summary is NOTHING_DRIVEN,
            summary=lambda: summary,
            figures=lambda: (),
            require_readable_bus=lambda: None,
        )
        self.bridge.__dict__.update(bridge)
        self.is_stop_requested = False
        self._signals = signals
        self._requested = Event()

    def start(self, *_: object) -> Thread:
        for _ in range(self._signals):
            for number in SIGNALS:
                signal.raise_signal(number)
        # Signals are passed on in a thread of their own.
        thread = Thread(target=self._requested.wait, args=(30.0 if self._signals else 0.0,))
        thread.start()
        return thread

    def request_stop(self) -> None:
        self.is_stop_requested = True
        self._requested.set()

    def close(self) -> None:
        self.is_stop_requested = True


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Call the program with a session, in this process; its exit code, stdout and stderr."""

    def call(session: Session, *options: str | Path) -> tuple[int, str, str]:
        monkeypatch.setattr(terminal, "open_session", lambda *_, **__: session)
        arguments = ("--bus", "local", "--priority", "0", *map(str, options))
        monkeypatch.setattr("sys.argv", ["sim-bridge", *arguments])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        shown = capsys.readouterr()
        return int(ended.value.code or 0), shown.out, shown.err

    return call


@pytest.mark.parametrize(("signals", "expected"), [(0, 5), (1, 0), (2, 0)])
def test_a_request_to_stop_while_it_waits_is_no_error_and_a_missing_controller_is_one(
    run: Run, signals: int, expected: int
) -> None:
    code, out, message = run(Session(signals, NOTHING_DRIVEN), "--quiet")
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

    monkeypatch.setattr(terminal, "write_figures", signal_and_write)
    assert run(Session(1, NOTHING_DRIVEN))[0] == 0


def test_a_bus_that_does_not_open_leaves_neither_the_log_nor_the_process_changed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise BusError("no such channel")

    monkeypatch.setattr(terminal, "open_session", fail)
    log = tmp_path / "drive.log"
    options = ("--bus", "local", "--priority", "0", "--record", str(log), "--quiet")
    monkeypatch.setattr("sys.argv", ["sim-bridge", *options])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 5
    assert capsys.readouterr().err == "sim-bridge: no such channel\n"
    assert not log.exists()
    assert "recorder" not in {thread.name for thread in running_threads()}
    assert gc.isenabled()


def test_a_drive_to_its_end_that_missed_a_limit_has_its_own_exit_code(
    run: Run, tmp_path: Path
) -> None:
    figures = (CarFigure("ey_peak_m", 0.3, 0.2, False), CarFigure("creep_m", 0.0, None, True))
    summary = tmp_path / "summary.json"
    session = Session(0, DRIVEN, figures=lambda: figures)
    code, out, message = run(session, "--quiet", "--json", summary)
    assert code == EXIT_LIMIT == 8
    assert out.index("figures of the scenario") < out.index("ey_peak_m   0.3 (limit 0.2")
    assert "found ey_peak_m missed" in message
    assert json.loads(summary.read_text())["limits_missed"] == ["ey_peak_m"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
@pytest.mark.parametrize(("summary", "expected"), [(NOTHING_DRIVEN, 5), (DRIVEN, 9)])
def test_a_summary_that_cannot_be_written_hides_no_other_failure(
    run: Run, summary: BridgeSummary, expected: int
) -> None:
    code, _, message = run(Session(0, summary), "--quiet", "--json", "/dev/full")
    assert code == expected
    assert "--json /dev/full: expected room for the figures" in message


def test_a_failed_plant_has_its_own_exit_code_and_its_reason_is_said(run: Run) -> None:
    failed = replace(DRIVEN, plant_failure="no fuel left")
    bridge = Session(0, failed)
    code, _, message = run(bridge, "--quiet")
    assert code == 7
    assert "no fuel left" in " ".join(message.split())


def test_a_bus_that_failed_in_the_drive_is_named_after_the_summary(
    run: Run, tmp_path: Path
) -> None:
    def fail() -> None:
        raise BusError("unplugged")

    summary = tmp_path / "summary.json"
    session = Session(0, BRAKED, require_readable_bus=fail)
    code, out, message = run(session, "--quiet", "--json", summary)
    assert code == 5
    assert "BRAKED BY THE WATCHDOG" in out
    assert "unplugged" in message
    assert json.loads(summary.read_text())["watchdog_braked"]


@pytest.mark.parametrize(
    ("cause", "failed", "refused", "expected"),
    [
        ("NO_COMMAND", (), {}, "for 100 ms. The controller stopped sending"),
        (
            "NO_COMMAND",
            (),
            {"LATE": 4},
            "for 100 ms. There were ticks with refused commands: 4 LATE.",
        ),
        ("NO_COMMAND", ("THROTTLE",), {}, "the throttle stays open. The controller stopped"),
        ("LEAVING_PATH", (), {}, "within 0.9 m of its path (0.5 m in a safe stop), found that"),
        ("LEAVING_PATH", ("STEERING_WHEEL",), {}, "its path; the steering wheel does not move."),
        ("ACTUATOR_FAILED", ("STEERING_WHEEL",), {}, "found that the steering wheel does not"),
    ],
)
def test_the_cause_of_the_braking_is_in_the_message_and_in_the_summary(
    run: Run,
    tmp_path: Path,
    cause: str,
    failed: tuple[str, ...],
    refused: dict[str, int],
    expected: str,
) -> None:
    summary = replace(BRAKED, braking_cause=cause, failed_actuators=failed, refused_ticks=refused)
    file = tmp_path / "summary.json"
    code, out, message = run(Session(0, summary), "--quiet", "--json", file)
    assert code == 5
    assert expected in message
    assert ("stopped sending" in message) is (cause == "NO_COMMAND" and not refused)
    assert f"BRAKED BY THE WATCHDOG: {summary.braking_text}" in out
    written = json.loads(file.read_text())
    assert (written["braking_cause"], written["failed_actuators"]) == (cause, list(failed))


@pytest.mark.parametrize(
    ("released", "speed_mps", "is_said"),
    [(True, 100.0 / 3.6, True), (True, 0.2, False), (False, 100.0 / 3.6, False)],
)
def test_the_summary_says_that_a_drive_was_stopped_and_the_speed_of_a_released_car(
    run: Run, released: bool, speed_mps: float, is_said: bool
) -> None:
    summary = replace(DRIVEN, released=released, final_speed_mps=speed_mps)
    code, out, _ = run(Session(1, summary), "--quiet")
    assert code == 0
    assert "40 ticks" in out
    assert "stopped on request before the end" in out
    assert ("released at 100 km/h" in out) is is_said


def test_help_offers_only_interfaces_that_other_processes_reach(run: Run) -> None:
    _, shown, _ = run(Session(0, DRIVEN), "--help")
    assert "socketcan" in shown
    assert "virtual" not in shown


def test_a_scenario_that_needs_too_much_steering_has_a_note_at_the_start(run: Run) -> None:
    content = {
        "format": 2, "name": "tight", "duration_s": 5.0, "road": {"curvature_per_m": 1.0 / 15.0},
        "reference": {"speed_kmh": 30.0},
    }  # fmt: skip
    _, _, message = run(Session(1, DRIVEN, scenario=parse_scenario(content, "test")))
    assert "note: scenario 'tight': a steady state needs about 218 deg" in message
