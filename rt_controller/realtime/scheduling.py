"""Real-time scheduling: requests to the operating system, and what it granted.

The process asks once, in its main thread and before it starts others (`prepare_process`); a
thread with a priority of its own asks for itself (`set_thread_priority`). A request that is
refused is no error.
"""

import ctypes
import gc
import os
import sys
from typing import NamedTuple

_MCL_CURRENT = 1
_MCL_FUTURE = 2
_LOWEST_FIFO_PRIORITY = 1
SWITCH_INTERVAL_S = 0.0005
"""longest time that another Python thread may hold the interpreter lock that the loop waits for"""


class ProcessSettings(NamedTuple):
    """What holds for the whole process until `release_process`."""

    memory_locked: bool
    collector_off: bool


class ThreadPriority(NamedTuple):
    """What holds for one thread, until it ends."""

    fifo_priority: int
    """0: SCHED_FIFO was not asked for or not granted"""
    cpu: int | None
    """the one core the thread is bound to"""


class Guarantees(NamedTuple):
    """What holds for the loop: settings of its process, priority of its thread."""

    process: ProcessSettings
    thread: ThreadPriority

    @property
    def scheduler(self) -> str:
        priority = self.thread.fifo_priority
        return f"SCHED_FIFO {priority}" if priority else "SCHED_OTHER"

    def sentence(self) -> str:
        """One line for the terminal and the log."""
        memory = "memory locked" if self.process.memory_locked else "memory NOT locked"
        collector = "collector off" if self.process.collector_off else "collector ON"
        core = "any core" if self.thread.cpu is None else f"core {self.thread.cpu}"
        return f"{self.scheduler}, {memory}, {collector}, {core}"


NO_GUARANTEES = Guarantees(ProcessSettings(False, False), ThreadPriority(0, None))


def prepare_process(priority: int) -> ProcessSettings:
    """Lock memory, switch the garbage collector off, give the calling thread the lowest priority.

    `priority` is the loop's; 0: no thread gets a real-time priority. The calling thread and all
    that it starts get the lowest one: one of them may hold the interpreter lock when the loop
    wakes up, and other programs must not keep it from releasing the lock.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    if priority > 0:
        _set_fifo(_LOWEST_FIFO_PRIORITY)
    is_locked = ctypes.CDLL(None).mlockall(_MCL_CURRENT | _MCL_FUTURE) == 0
    return ProcessSettings(memory_locked=is_locked, collector_off=not gc.isenabled())


def set_thread_priority(priority: int, cpu: int | None = None) -> ThreadPriority:
    """Give the calling thread a SCHED_FIFO priority, and bind it to one core; what was granted."""
    return ThreadPriority(
        fifo_priority=priority if priority > 0 and _set_fifo(priority) else 0,
        cpu=cpu if cpu is not None and _bind(cpu) else None,
    )


def release_process() -> None:
    """Undo `prepare_process`; call it in the same thread."""
    gc.enable()
    gc.unfreeze()
    if os.sched_getscheduler(0) != os.SCHED_OTHER:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    ctypes.CDLL(None).munlockall()


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
