"""What a command shows while it runs."""

import json
import sys
from collections.abc import Callable
from itertools import count
from math import inf
from pathlib import Path
from threading import Semaphore, Thread
from types import SimpleNamespace
from typing import cast

import can
import pytest
from own_car import EXAMPLE, VALUES, changed, example, state_writer

import rt_controller.cli
from rt_controller.contract.signals import Mode
from rt_controller.drive.trace import DriveTrace
from rt_controller.loop import RunRecord
from rt_controller.realtime.scheduling import NO_GUARANTEES
from rt_controller.realtime.timing import DeadlineAccount
from rt_controller.safety.tick import Tick
from rt_controller.session import ControllerSession
from rt_controller.terminal import progress
from rt_controller.terminal.command_line import run_command
from rt_controller.terminal.progress import Line
from rt_controller.terminal.summary import STILL_STOPPING, STOPPING, live_lines


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "LIVE_INTERVAL_S", 0.001)
    monkeypatch.setattr(progress, "LOG_INTERVAL_S", inf)


def started(work: Callable[[], None]) -> Thread:
    thread = Thread(target=work)
    thread.start()
    return thread


def test_a_log_shows_a_line_when_what_happens_has_changed_and_at_the_end(capsys):
    calls = Semaphore(0)
    numbers = count()

    def line():
        calls.release()
        number = next(numbers)
        return Line("waiting") if number < 5 else Line("driving", f"tick {number}")

    def work():
        for _ in range(20):
            calls.acquire()

    progress.watch(started(work), line, False)
    shown = capsys.readouterr().err.splitlines()
    assert shown[:2] == ["waiting", "driving  tick 5"]
    assert len(shown) == 3  # the last one at the end


def test_the_lines_of_a_run_show_each_mode_once_and_what_the_system_granted(capsys):
    calls = Semaphore(0)
    session = SimpleNamespace(
        is_joined=False,
        stop_requests=0,
        recorder=None,
        guarantees=NO_GUARANTEES,
        is_lockstep=False,
        record=RunRecord(DeadlineAccount(10, 1), DriveTrace(10)),
    )
    lines = live_lines(cast("ControllerSession", session))

    def line():
        calls.release()
        return next(lines)

    def work():
        for _ in range(5):
            calls.acquire()
        session.is_joined = True
        for _ in range(10):
            calls.acquire()
        session.record.result = Tick(mode=Mode.NOMINAL)
        for _ in range(10):
            calls.acquire()
        for _ in range(3):
            session.stop_requests += 1
            for _ in range(10):
                calls.acquire()

    progress.watch(started(work), line, False)
    shown = capsys.readouterr().err.splitlines()
    for note in (STOPPING, STILL_STOPPING):
        assert shown.count(note) == 1
        shown.remove(note)
    assert shown[:2] == ["waiting for the vehicle", NO_GUARANTEES.sentence()]
    assert [text.split()[0] for text in shown[2:]] == ["STANDBY", "NOMINAL"]


def test_a_warning_is_shown_also_by_a_quiet_command(capsys):
    lines = iter([Line("driving", warning="the disk is full")])
    progress.watch(started(lambda: None), lambda: next(lines, Line("driving")), True)
    assert capsys.readouterr().err == "the disk is full\n"


def test_a_quiet_command_shows_neither_lines_nor_messages(capsys):
    with progress.announce(progress.SETTLING):
        assert "settling the car" in capsys.readouterr().err
    with progress.announce(progress.SETTLING, is_quiet=True):
        progress.watch(started(lambda: None), lambda: Line("driving", note="granted"), True)
    assert capsys.readouterr().err == ""


def test_a_live_line_fits_into_the_terminal_and_replaces_all_that_stood_there(capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    for name, value in {"TERM": "xterm", "COLUMNS": "40"}.items():
        monkeypatch.setenv(name, value)
    calls = Semaphore(0)

    def line():
        calls.release()
        return Line("driving", "figure " * 20)

    def work():
        for _ in range(3):
            calls.acquire()

    progress.watch(started(work), line, False)
    shown = capsys.readouterr().err
    assert shown.startswith("\r\x1b[2K")
    last = shown.split("\x1b[2K")[-1]
    assert len(last) == 40  # 39 characters and the end of the line
    assert last.endswith("…\n")


STRAIGHT = {"inputs.steer_rad": 0.0, "states.yaw_rate_radps": 0.0}


def run_signals(*arguments: str) -> int:
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
    log, tmp_path, capsys
):
    assert (
        run_signals("signals", "check", str(EXAMPLE), str(log), "--json", str(tmp_path / "f.json"))
        == 8
    )
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


def test_messages_that_cannot_be_read_are_counted_in_a_note(log, tmp_path, capsys):
    defect = '\nBO_ 900 Radio: 8 CAR\n SG_ Volume : 60|8@1+ (1,0) [0|1] "" CAR\n\nBA_DEF_ BO_ "Gen'
    changed(tmp_path, ('\nBA_DEF_ BO_ "Gen', defect))
    assert run_signals("signals", "check", str(tmp_path / "car.toml"), str(log)) == 8
    shown = " ".join(capsys.readouterr().err.split())
    assert "messages cannot be read (first: Radio: The signal Volume does not fit in" in shown
    assert "note: car.dbc: 1 of " in shown


def test_a_quiet_check_shows_no_progress(capsys):
    options = ("--bus", "virtual", "--channel", "quiet", "--listen-s", "0.01")
    assert run_signals("signals", "check", str(EXAMPLE), *options) == 8
    assert "listening for" in capsys.readouterr().err
    assert run_signals("signals", "check", str(EXAMPLE), *options, "--quiet") == 8
    assert capsys.readouterr().err == ""
