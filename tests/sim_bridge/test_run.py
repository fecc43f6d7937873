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
from sim_bridge import cli, session
from sim_bridge.scenario import load_scenario, parse_scenario
from sim_bridge.summary import BridgeSummary

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

    def call(opened: Session, *options: str | Path) -> tuple[int, str, str]:
        monkeypatch.setattr(session, "open_session", lambda *_, **__: opened)
        arguments = ("--bus", "local", "--priority", "0", *map(str, options))
        monkeypatch.setattr("sys.argv", ["sim-bridge", *arguments])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        shown = capsys.readouterr()
        return int(ended.value.code or 0), shown.out, shown.err

    return call


def test_signals_while_the_summary_is_written_change_nothing(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def signal_and_write(*_: object) -> None:
        for number in SIGNALS:
            signal.raise_signal(number)
            signal.raise_signal(number)

    monkeypatch.setattr(cli, "write_figures", signal_and_write)
    assert run(Session(1, NOTHING_DRIVEN))[0] == 0


def test_a_bus_that_does_not_open_leaves_neither_the_log_nor_the_process_changed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise BusError("no such channel")

    monkeypatch.setattr(session, "open_session", fail)
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


def test_a_scenario_that_needs_too_much_steering_has_a_note_at_the_start(run: Run) -> None:
    content = {
        "format": 2, "name": "tight", "duration_s": 5.0, "road": {"curvature_per_m": 1.0 / 9.5},
        "reference": {"speed_kmh": 30.0},
    }  # fmt: skip
    _, _, message = run(Session(1, DRIVEN, scenario=parse_scenario(content, "test")))
    assert "note: scenario 'tight': a steady state needs about 344 deg" in message


@pytest.mark.parametrize(("signals", "expected"), [(0, 5), (1, 0), (2, 0)])
def test_a_request_to_stop_while_it_waits_is_no_error_and_a_missing_controller_is_one(
    run: Run, signals: int, expected: int
) -> None:
    code, out, message = run(Session(signals, NOTHING_DRIVEN), "--quiet")
    assert code == expected
    assert out.startswith("ended before a controller took the car") is (expected == 0)
    assert message == "" or expected == 5


FIGURES = (CarFigure("ey_peak_m", 0.3, 0.2, False), CarFigure("creep_m", 0.0, None, True))
FAST = replace(DRIVEN, final_speed_mps=100.0 / 3.6)


def unreadable() -> None:
    raise BusError("unplugged")


def braked(cause: str, *failed: str, **refused: int) -> BridgeSummary:
    return replace(BRAKED, braking_cause=cause, failed_actuators=failed, refused_ticks=refused)


@pytest.mark.parametrize(
    ("summary", "bridge", "expected", "shown", "said"),
    [
        (DRIVEN, {"figures": lambda: FIGURES}, EXIT_LIMIT, "ey_peak_m  0.3 (limit 0.2",
         "found ey_peak_m missed"),
        (replace(DRIVEN, plant_failure="no fuel left"), {}, 7, "40 ticks", "no fuel left"),
        (BRAKED, {"require_readable_bus": unreadable}, 5, "BRAKED BY THE WATCHDOG", "unplugged"),
        (braked("NO_COMMAND"), {}, 5, "BRAKED BY THE WATCHDOG: ",
         "for 100 ms. The controller stopped sending"),
        (braked("NO_COMMAND", LATE=4), {}, 5, "BRAKED",
         "for 100 ms. There were ticks with refused commands: 4 LATE."),
        (braked("NO_COMMAND", "THROTTLE"), {}, 5, "BRAKED",
         "the throttle stays open. The controller stopped"),
        (braked("LEAVING_PATH"), {}, 5, "BRAKED",
         "within 0.9 m of its path (0.5 m in a safe stop), found that"),
        (braked("LEAVING_PATH", "STEERING_WHEEL"), {}, 5, "BRAKED",
         "its path; the steering wheel does not move."),
        (braked("ACTUATOR_FAILED", "STEERING_WHEEL"), {}, 5, "BRAKED",
         "found that the steering wheel does not"),
        (replace(FAST, released=True), {}, 0, "released at 100 km/h", ""),
        (FAST, {}, 0, "stopped on request before the end", ""),
    ],
)  # fmt: skip
def test_the_end_of_a_drive_has_its_exit_code_its_summary_and_its_message(
    run: Run,
    tmp_path: Path,
    summary: BridgeSummary,
    bridge: dict[str, Any],
    expected: int,
    shown: str,
    said: str,
) -> None:
    file = tmp_path / "summary.json"
    code, out, message = run(Session(expected == 0, summary, **bridge), "--quiet", "--json", file)
    assert code == expected
    assert shown in out
    assert said in " ".join(message.split())
    assert ("released at" in out) is summary.released
    written = json.loads(file.read_text())
    assert written["limits_missed"] == (["ey_peak_m"] if "figures" in bridge else [])
    assert written["watchdog_braked"] is summary.watchdog_braked
    assert written["braking_cause"] == summary.braking_cause
    assert written["failed_actuators"] == list(summary.failed_actuators)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
@pytest.mark.parametrize(("summary", "expected"), [(NOTHING_DRIVEN, 5), (DRIVEN, 9)])
def test_a_summary_that_cannot_be_written_hides_no_other_failure(
    run: Run, summary: BridgeSummary, expected: int
) -> None:
    code, _, message = run(Session(0, summary), "--quiet", "--json", "/dev/full")
    assert code == expected
    assert "--json /dev/full: expected room for the figures" in message
