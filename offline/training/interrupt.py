"""Stop requests by signals, so that a long run can end after a checkpoint."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any


@contextmanager
def stop_on_signals(
    on_request: Callable[[], None] = lambda: None,
) -> Iterator[Callable[[], bool]]:
    """Yields a function that is true once SIGINT (Ctrl-C), SIGTERM or SIGHUP was received.

    `on_request` is called when the first signal is received; a second one has its usual effect. A
    hang-up that the program was started to ignore (nohup) stays ignored.
    """
    requested = False
    previous: dict[signal.Signals, Any] = {}

    def restore() -> None:
        for number, handler in previous.items():
            signal.signal(number, handler)

    def request(number: int, frame: FrameType | None) -> None:
        nonlocal requested
        requested = True
        restore()
        on_request()

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if number is not signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
            previous[number] = signal.signal(number, request)
    try:
        yield lambda: requested
    finally:
        restore()
