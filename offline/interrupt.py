"""Asking a long run to stop where nothing is lost."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

INTERRUPTED = 130
"""exit code of a program that was asked to stop, as shells have it"""


@contextmanager
def stop_on_signals() -> Iterator[Callable[[], bool]]:
    """Yields whether a stop was requested, by Ctrl-C or a polite kill.

    A second one has its usual effect.
    """
    requested = False
    previous: dict[signal.Signals, Any] = {}

    def restore() -> None:
        for number, handler in previous.items():
            signal.signal(number, handler)

    def ask(number: int, frame: FrameType | None) -> None:
        nonlocal requested
        requested = True
        restore()

    for number in (signal.SIGINT, signal.SIGTERM):
        previous[number] = signal.signal(number, ask)
    try:
        yield lambda: requested
    finally:
        restore()
