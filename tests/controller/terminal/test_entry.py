"""Ctrl-C, SIGTERM and SIGHUP at any time end a program well; a lost output ends no drive."""

import os
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest

from rt_controller.terminal.entry import INTERRUPTED, start
from rt_controller.terminal.stop_signals import SIGNALS, stop_on_signals

PROJECT = Path(__file__).parents[3] / "pyproject.toml"
COMMANDS: dict[str, str] = tomllib.loads(PROJECT.read_text())["project"]["scripts"]
STARTED = "started"
LISTENING = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
"""first, because a test run in the background ignores Ctrl-C"""
WAIT = "for _ in range(3000): time.sleep(0.02)"
"""a signal just before a long sleep would be handled only after it"""


def interrupted(script: str) -> tuple[int, str]:
    """Exit code and stderr of a script that gets Ctrl-C when it has started."""
    process = subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout.readline().strip() == STARTED
    process.send_signal(signal.SIGINT)
    err = process.communicate(timeout=60)[1]
    return process.returncode, err


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
    try:
        print({STARTED!r}, flush=True)
        {WAIT}
    finally:
        open(__file__ + ".cleaned", "w").close()
""",
    ],
)
def test_ctrl_c_ends_an_import_and_the_work_after_it_which_cleans_up(text, tmp_path):
    code, err = interrupted(LISTENING + waiting_module(tmp_path, text))
    assert (code, err) == (INTERRUPTED, "program: ended by Ctrl-C\n")
    assert (tmp_path / "loaded.py.cleaned").exists() is ("finally" in text)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are found on Linux")
@pytest.mark.parametrize("delay_s", [0.6, 1.2, 2.5])
def test_ctrl_c_at_a_terminal_ends_the_data_generation_with_its_processes(delay_s, tmp_path):
    """While it imports, while its workers start, and while they work; all get the signal."""
    pytest.importorskip("torch")
    script = f"{LISTENING}from offline.entry import data_main; data_main()"
    process = subprocess.Popen(
        [sys.executable, "-c", script, "--jobs", "2", "--data", str(tmp_path / "set")],
        start_new_session=True,
        stderr=subprocess.PIPE,
        text=True,
    )
    time.sleep(delay_s)
    os.killpg(process.pid, signal.SIGINT)
    err = process.communicate(timeout=60)[1]  # which workers that are left would keep open
    messages = [line for line in err.splitlines() if not line.startswith(("making", "simulating"))]
    assert (process.returncode, messages) == (INTERRUPTED, ["offline-data: ended by Ctrl-C"])
    assert not (tmp_path / "set" / "manifest.json").exists()


def test_an_ignored_ctrl_c_stays_ignored(tmp_path):
    text = f"""
import os, signal
def main():
    print({STARTED!r}, flush=True)
    os.kill(os.getpid(), signal.SIGINT)
"""
    script = "import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)"
    code, err = interrupted(script + waiting_module(tmp_path, text))
    assert (code, err) == (0, "")


def test_every_command_starts_by_its_entry(monkeypatch):
    """With the handler of Ctrl-C set before the command's modules are imported."""
    assert start.__module__ == "rt_controller.terminal.entry"
    for name, target in COMMANDS.items():
        module, function = target.split(":")
        entry = getattr(__import__(module, fromlist=[function]), function)
        assert entry.func is start
        assert entry.args[0] == name


SIGNALLED_WHILE_IT_ENDS = """
import atexit, signal, sys
from rt_controller.terminal.stop_signals import SIGNALS, stop_on_signals
for number in SIGNALS:
    atexit.register(signal.raise_signal, number)
with stop_on_signals(lambda: None):
    pass
sys.exit(6)
"""


@pytest.mark.usefixtures("default_hang_up")
def test_every_signal_requests_a_stop_and_the_handlers_are_put_back():
    before = [signal.getsignal(number) for number in SIGNALS]
    requests: list[None] = []
    with stop_on_signals(lambda: requests.append(None)):
        for number in SIGNALS:
            signal.raise_signal(number)
            signal.raise_signal(number)
    assert len(requests) == 2 * len(SIGNALS) == 6
    assert [signal.getsignal(number) for number in SIGNALS] == before


@pytest.mark.usefixtures("default_hang_up")
def test_a_signal_while_the_interpreter_ends_does_not_change_the_exit_code():
    ended = subprocess.run([sys.executable, "-c", SIGNALLED_WHILE_IT_ENDS], check=False)
    assert ended.returncode == 6


STUCK = """
import os, signal, sys, threading
from rt_controller.terminal import stop_signals
stop_signals.LONGEST_LEAVE_S = 0.05
with stop_signals.stop_on_signals(lambda: None):
    for _ in range(int(sys.argv[1])):
        signal.raise_signal(signal.SIGTERM)
    stuck = threading.Lock()
    stuck.acquire()
    print(stuck.acquire(timeout=float(sys.argv[2])))
sys.exit(6)
"""


@pytest.mark.parametrize(("signals", "wait_s", "expected"), [(2, 0.2, 6), (3, 60.0, 130)])
def test_the_third_signal_ends_a_process_that_does_not_end_by_itself(signals, wait_s, expected):
    command = [sys.executable, "-c", STUCK, str(signals), str(wait_s)]
    assert subprocess.run(command, check=False, capture_output=True).returncode == expected


@pytest.mark.usefixtures("default_hang_up")
def test_a_hang_up_that_was_ignored_at_the_start_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    requests: list[None] = []
    try:
        with stop_on_signals(lambda: requests.append(None)):
            signal.raise_signal(signal.SIGHUP)
        assert not requests
    finally:
        signal.signal(signal.SIGHUP, before)


PRINT_LATE = """
import sys
from rt_controller.terminal.command_line import new_app, run_command
app = new_app("late", "Prints late.")
@app.default
def run() -> int:
    sys.stdin.read()
    for stream in (sys.stdout, sys.stderr):
        for _ in range(3):
            print("a line of progress", file=stream)
        stream.flush()
    return 6
run_command(app)
"""


def test_output_that_cannot_be_written_raises_nothing():
    pipe = subprocess.PIPE
    with subprocess.Popen(
        [sys.executable, "-c", PRINT_LATE], stdin=pipe, stdout=pipe, stderr=pipe
    ) as process:
        for stream in (process.stdout, process.stderr, process.stdin):
            stream.close()
        assert process.wait() == 6


COUNT_THREADS = "import rt_controller.cli, numpy, os; print(len(os.listdir('/proc/self/task')))"


def threads_after_import(blas_threads: str | None) -> int:
    chosen = {} if blas_threads is None else {"OPENBLAS_NUM_THREADS": blas_threads}
    inherited = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    environment = {**inherited, "OMP_NUM_THREADS": "2", **chosen}
    command = [sys.executable, "-c", COUNT_THREADS]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return int(done.stdout)


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="threads are counted on Linux")
def test_linear_algebra_runs_in_one_thread_unless_the_user_sets_more():
    single = threads_after_import("1")
    assert threads_after_import(None) == single
    if len(os.sched_getaffinity(0)) > 1:
        assert threads_after_import("2") > single
