"""Ctrl-C at any time of the start of a command ends it with one line and exit code 130."""

import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest

from rt_controller.terminal.entry import INTERRUPTED, start

PROJECT = Path(__file__).parents[3] / "pyproject.toml"
COMMANDS: dict[str, str] = tomllib.loads(PROJECT.read_text())["project"]["scripts"]
STARTED = "started"
LISTENING = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
"""first, because a test run in the background ignores Ctrl-C"""
WAIT = "for _ in range(3000): time.sleep(0.02)"
"""a signal just before a long sleep would be handled only after it"""
LONGEST_START_S = 1.0
"""later signals meet some of the commands at work"""


def interrupted_after(delay_s: float, script: str) -> tuple[int, str]:
    """Exit code and stderr of a script that gets Ctrl-C so long after it has imported its entry."""
    process = subprocess.Popen(
        [sys.executable, "-c", script],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline().strip() == STARTED
    time.sleep(delay_s)
    process.send_signal(signal.SIGINT)
    err = process.communicate(timeout=60)[1]
    return process.returncode, err


def script_of(command: str) -> str:
    """As the console script, with a wait at the end, so that it does not end before the signal."""
    module, function = COMMANDS[command].split(":")
    return f"""{LISTENING}
import sys, time
from {module} import {function}
sys.argv = [{command!r}, "--version"]
print({STARTED!r}, file=sys.__stdout__, flush=True)
leave = sys.exit
def leave_or_wait(code):
    if code == {INTERRUPTED}:
        leave(code)
    {WAIT}
sys.exit = leave_or_wait
{function}()
"""


@pytest.mark.nightly
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("step", [3, 12])
def test_ctrl_c_while_a_command_is_loading_ends_it_with_one_line(command: str, step: int) -> None:
    code, err = interrupted_after(LONGEST_START_S * step / 20, script_of(command))
    assert (code, err) == (INTERRUPTED, f"{command}: ended by Ctrl-C\n")


def waiting_module(folder: Path, text: str) -> str:
    """A script that starts a module of this text."""
    (folder / "loaded.py").write_text(text)
    return f"""
import sys
sys.path.insert(0, {str(folder)!r})
from rt_controller.terminal.entry import start
start("program", "loaded")
"""


@pytest.mark.parametrize(
    "text",
    [
        f"""
import time
try:
    print({STARTED!r}, flush=True)
    {WAIT}
except BaseException:  # as a compiled module may do while it is initialised
    {WAIT}
""",
        f"""
import time
def main():
    print({STARTED!r}, flush=True)
    {WAIT}
""",
    ],
)
def test_ctrl_c_ends_an_import_and_the_work_after_it(text: str, tmp_path: Path) -> None:
    code, err = interrupted_after(0.0, LISTENING + waiting_module(tmp_path, text))
    assert (code, err) == (INTERRUPTED, "program: ended by Ctrl-C\n")


def test_a_command_at_work_cleans_up_after_ctrl_c(tmp_path: Path) -> None:
    text = f"""
import time
def main():
    try:
        print({STARTED!r}, flush=True)
        {WAIT}
    finally:
        open({str(tmp_path / "cleaned")!r}, "w").close()
"""
    assert interrupted_after(0.0, LISTENING + waiting_module(tmp_path, text))[0] == INTERRUPTED
    assert (tmp_path / "cleaned").exists()


def test_an_ignored_ctrl_c_stays_ignored(tmp_path: Path) -> None:
    text = f"""
import os, signal
def main():
    print({STARTED!r}, flush=True)
    os.kill(os.getpid(), signal.SIGINT)
"""
    script = "import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)"
    code, err = interrupted_after(0.0, script + waiting_module(tmp_path, text))
    assert (code, err) == (0, "")


def test_every_command_starts_by_its_entry(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the handler of Ctrl-C set before the command's modules are imported."""
    assert start.__module__ == "rt_controller.terminal.entry"
    for name, target in COMMANDS.items():
        module, function = target.split(":")
        entry = getattr(__import__(module, fromlist=[function]), function)
        assert entry.func is start
        assert entry.args[0] == name
