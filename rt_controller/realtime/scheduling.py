"""Real-time scheduling: requests to the operating system, and what it granted.

The process asks once, in its main thread and before it starts others (`real_time_process`); a
thread with a priority of its own asks for itself (`set_thread_priority`). A request that is
refused is no error.
"""

import ctypes
import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Lock
from typing import NamedTuple

_MCL_CURRENT = 1
_MCL_FUTURE = 2
_LOWEST_FIFO_PRIORITY = 1
SWITCH_INTERVAL_S = 0.0005
"""longest time that another Python thread may hold the interpreter lock that the loop waits for"""


class Guarantees(NamedTuple):
    """What the operating system granted: for the process, and for the thread of the loop."""

    memory_locked: bool = False
    collector_off: bool = False
    fifo_priority: int = 0
    """of the thread; 0: SCHED_FIFO was not asked for or not granted"""
    cpu: int | None = None
    """the one core the thread is bound to"""

    @property
    def scheduler(self) -> str:
        return f"SCHED_FIFO {self.fifo_priority}" if self.fifo_priority else "SCHED_OTHER"

    def sentence(self) -> str:
        """One line for the terminal and the log."""
        memory = "memory locked" if self.memory_locked else "memory NOT locked"
        collector = "garbage collector off" if self.collector_off else "garbage collector ON"
        core = "any core" if self.cpu is None else f"core {self.cpu}"
        return f"{self.scheduler}, {memory}, {collector}, {core}"


NO_GUARANTEES = Guarantees()


class _InterpreterSettings:
    """Garbage collector and switch interval, for all contexts that are open at the same time.

    They belong to the process: the last context that ends restores what the first one found.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._contexts = 0
        self._was_collecting = True
        self._switch_interval_s = 0.0

    def change(self) -> None:
        with self._lock:
            if self._contexts == 0:
                self._was_collecting = gc.isenabled()
                self._switch_interval_s = sys.getswitchinterval()
            self._contexts += 1
            gc.collect()
            gc.freeze()
            gc.disable()
            sys.setswitchinterval(SWITCH_INTERVAL_S)

    def restore(self) -> None:
        with self._lock:
            self._contexts -= 1
            if self._contexts > 0:
                return
            gc.unfreeze()
            sys.setswitchinterval(self._switch_interval_s)
            if self._was_collecting:
                gc.enable()


_interpreter_settings = _InterpreterSettings()


@contextmanager
def real_time_process(priority: int, lock_memory: bool = True) -> Iterator[Guarantees]:
    """Lock memory, switch the garbage collector off, give the calling thread the lowest priority.

    The end of the context, in the same thread, restores the settings that were found.

    `priority` is the loop's; 0: no thread gets a real-time priority. The calling thread and all
    that it starts get the lowest one: one of them may hold the interpreter lock when the loop
    wakes up, and other programs must not keep it from releasing the lock. Locking takes seconds in
    a process that has reserved much memory, such as a notebook.
    """
    system = ctypes.CDLL(None)
    found = os.sched_getscheduler(0), os.sched_getparam(0)
    _interpreter_settings.change()
    if priority > 0:
        _set_fifo(_LOWEST_FIFO_PRIORITY)
    is_locked = lock_memory and system.mlockall(_MCL_CURRENT | _MCL_FUTURE) == 0
    try:
        yield Guarantees(memory_locked=is_locked, collector_off=not gc.isenabled())
    finally:
        _interpreter_settings.restore()
        if (os.sched_getscheduler(0), os.sched_getparam(0)) != found:
            with suppress(OSError):  # a higher priority than this process may ask for
                os.sched_setscheduler(0, *found)
        if is_locked:
            system.munlockall()


def set_thread_priority(
    priority: int, cpu: int | None = None, process: Guarantees = NO_GUARANTEES
) -> Guarantees:
    """Give the calling thread a SCHED_FIFO priority, and bind it to one core.

    Returns what was granted to it, together with what its process was granted.
    """
    return process._replace(
        fifo_priority=priority if priority > 0 and _set_fifo(priority) else 0,
        cpu=cpu if cpu is not None and _bind(cpu) else None,
    )


def _set_fifo(priority: int) -> bool:
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (OSError, ValueError):
        return False
    return os.sched_getscheduler(0) == os.SCHED_FIFO


def _bind(cpu: int) -> bool:
    try:
        os.sched_setaffinity(0, {cpu})
    except (OSError, ValueError, OverflowError):
        return False
    return True
