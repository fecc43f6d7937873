"""Ctrl-C, SIGTERM and SIGHUP as requests to stop, for the programs that drive a car."""

import atexit
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Timer

from rt_controller.terminal.entry import INTERRUPTED

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
LEAVING_SIGNAL = 3
"""the signal that ends the drive at once; those before it brake the car"""
LONGEST_LEAVE_S = 5.0
"""after the leaving signal; then the process ends, whatever it waits for"""


@contextmanager
def stop_on_signals(stop: Callable[[], None]) -> Iterator[None]:
    """Call `stop` at each of the signals in this context, instead of ending the program.

    The context includes everything that the program writes at its end, and the interpreter ignores
    the signals while it ends: a further one changes neither results nor exit code, unless the
    program has not ended `LONGEST_LEAVE_S` after the third. A hang-up that the program was started
    to ignore (nohup) stays ignored.
    """
    leaving = Timer(LONGEST_LEAVE_S, os._exit, (INTERRUPTED,))
    leaving.daemon = True
    count = 0

    def handle(*_: object) -> None:
        nonlocal count
        count += 1
        stop()
        if count == LEAVING_SIGNAL:
            leaving.start()

    is_nohup = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    found = {number: signal.signal(number, handle) for number in SIGNALS[: 2 if is_nohup else 3]}
    for number in found:
        atexit.register(signal.signal, number, signal.SIG_IGN)
    try:
        yield
    finally:
        for number, handler in found.items():
            signal.signal(number, handler)
        leaving.cancel()
