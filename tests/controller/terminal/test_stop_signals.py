"""Ctrl-C, SIGTERM and SIGHUP as requests to stop."""

import signal
import subprocess
import sys

import pytest

from rt_controller.terminal.stop_signals import SIGNALS, stop_on_signals

pytestmark = pytest.mark.usefixtures("default_hang_up")

SIGNALLED_WHILE_IT_ENDS = """
import atexit, signal, sys
from rt_controller.terminal.stop_signals import SIGNALS, stop_on_signals
for number in SIGNALS:
    atexit.register(signal.raise_signal, number)
with stop_on_signals(lambda: None):
    pass
sys.exit(6)
"""


def test_every_signal_requests_a_stop_and_the_handlers_are_put_back() -> None:
    before = [signal.getsignal(number) for number in SIGNALS]
    requests: list[None] = []
    with stop_on_signals(lambda: requests.append(None)):
        for number in SIGNALS:
            signal.raise_signal(number)
            signal.raise_signal(number)
    assert len(requests) == 2 * len(SIGNALS) == 6
    assert [signal.getsignal(number) for number in SIGNALS] == before


def test_a_signal_while_the_interpreter_ends_does_not_change_the_exit_code() -> None:
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
def test_the_third_signal_ends_a_process_that_does_not_end_by_itself(
    signals: int, wait_s: float, expected: int
) -> None:
    command = [sys.executable, "-c", STUCK, str(signals), str(wait_s)]
    assert subprocess.run(command, check=False, capture_output=True).returncode == expected


def test_a_hang_up_that_was_ignored_at_the_start_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    requests: list[None] = []
    try:
        with stop_on_signals(lambda: requests.append(None)):
            signal.raise_signal(signal.SIGHUP)
        assert not requests
    finally:
        signal.signal(signal.SIGHUP, before)
