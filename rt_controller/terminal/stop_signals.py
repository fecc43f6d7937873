"""Ctrl-C and SIGTERM as requests to stop, for the programs that drive a car."""

import atexit
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def stop_on_signals(stop: Callable[[], None]) -> Iterator[None]:
    """Call `stop` at each Ctrl-C and SIGTERM in this context, instead of ending the program.

    The context includes everything that the program writes at its end, and the interpreter ignores
    both signals while it ends: a further one changes neither results nor exit code.
    """
    found = {number: signal.signal(number, lambda *_: stop()) for number in SIGNALS}
    for number in SIGNALS:
        atexit.register(signal.signal, number, signal.SIG_IGN)
    try:
        yield
    finally:
        for number, handler in found.items():
            # None: a handler that was not set by Python, and cannot be set again.
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
