"""Ctrl-C and SIGTERM as requests to stop."""

import signal
import subprocess
import sys

import pytest

from rt_controller.terminal.stop_signals import SIGNALS, stop_on_signals

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
    assert len(requests) == 4
    assert [signal.getsignal(number) for number in SIGNALS] == before


def test_a_handler_that_python_did_not_set_becomes_the_default(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    setter = signal.signal
    monkeypatch.setattr(signal, "signal", lambda number, handler: setter(number, handler) and None)
    before = [signal.getsignal(number) for number in SIGNALS]
    try:
        with stop_on_signals(lambda: None):
            pass
        assert [signal.getsignal(number) for number in SIGNALS] == 2 * [signal.SIG_DFL]
    finally:
        for number, handler in zip(SIGNALS, before, strict=True):
            setter(number, handler)


def test_a_signal_while_the_interpreter_ends_does_not_change_the_exit_code() -> None:
    ended = subprocess.run([sys.executable, "-c", SIGNALLED_WHILE_IT_ENDS], check=False)
    assert ended.returncode == 6
