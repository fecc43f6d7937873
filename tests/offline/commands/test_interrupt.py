"""Signals that end a long run after a checkpoint."""

import os
import signal

import pytest

from offline.commands.terminal import stop_on_signals

pytestmark = pytest.mark.usefixtures("default_hang_up")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_requests_the_end_and_its_handler_is_put_back(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    requests = []
    with stop_on_signals(lambda: requests.append(number)) as is_requested:
        assert not is_requested()
        os.kill(os.getpid(), number)
        assert is_requested()
    assert requests == [number]
    assert signal.getsignal(number) is before


def test_a_hang_up_that_was_ignored_at_the_start_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stop_on_signals() as is_requested:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not is_requested()
    finally:
        signal.signal(signal.SIGHUP, before)
