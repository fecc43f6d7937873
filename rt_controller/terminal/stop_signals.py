"""Ctrl-C, SIGTERM and SIGHUP as requests to stop, for the programs that drive a car.

A thread of its own reads them, so that they count whatever the main thread waits for.
"""

import atexit
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Thread, Timer

from rt_controller.terminal.entry import INTERRUPTED

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
LEAVING_SIGNAL = 3
"""the signal that ends the drive at once; those before it brake the car"""
LONGEST_LEAVE_S = 5.0
"""after the leaving signal; then the process ends, whatever it waits for"""


@contextmanager
def stop_on_signals(stop: Callable[[], None]) -> Iterator[None]:
    """Call `stop` at each of the signals in this context, instead of ending the program.

    `stop` is called in another thread. The context includes everything that the program writes at
    its end, and the interpreter ignores the signals while it ends: a further one changes neither
    results nor exit code, unless the program has not ended `LONGEST_LEAVE_S` after the third. A
    hang-up that the program was started to ignore (nohup) stays ignored.
    """
    handled = [number for number in SIGNALS if not _is_ignored_hangup(number)]
    readable, writable = os.pipe()
    os.set_blocking(writable, False)
    reader = Thread(target=_read_signals, args=(readable, stop), name="signals", daemon=True)
    reader.start()
    # The interpreter writes the number there at once, also while the main thread is in C code.
    former_pipe = signal.set_wakeup_fd(writable)
    found = {number: signal.signal(number, lambda *_: None) for number in handled}
    for number in handled:
        atexit.register(signal.signal, number, signal.SIG_IGN)
    try:
        yield
    finally:
        for number, handler in found.items():
            # None: a handler that was not set by Python, and cannot be set again.
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        signal.set_wakeup_fd(former_pipe)
        os.close(writable)
        reader.join()
        os.close(readable)


def _is_ignored_hangup(number: signal.Signals) -> bool:
    return number is signal.SIGHUP and signal.getsignal(number) is signal.SIG_IGN


def _read_signals(readable: int, stop: Callable[[], None]) -> None:
    """Pass each signal on until the pipe is closed; leave the process if it does not end."""
    leaving = Timer(LONGEST_LEAVE_S, os._exit, (INTERRUPTED,))
    leaving.daemon = True
    count = 0
    while numbers := os.read(readable, 64):
        for number in numbers:
            if number not in SIGNALS:
                continue
            count += 1
            stop()
            if count == LEAVING_SIGNAL:
                leaving.start()
    leaving.cancel()
