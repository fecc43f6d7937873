"""Asking the operating system for real-time conduct, and saying what it granted.

The process asks once, in its main thread and before it starts others (`prepare_process`); each
thread with a rank of its own asks for itself (`rank_thread`). Nothing here is fatal.
"""

import ctypes
import gc
import os
import sys
from typing import NamedTuple

_MCL_CURRENT = 1
_MCL_FUTURE = 2
_ATTENDANT_PRIORITY = 1
SWITCH_INTERVAL_S = 0.0005
"""how long another Python thread may keep the interpreter from the loop"""


class ProcessConduct(NamedTuple):
    """What holds for the whole process until `release_process`."""

    memory_locked: bool
    collector_off: bool


class ThreadRank(NamedTuple):
    """What holds for one thread, until it ends."""

    fifo_priority: int
    """0: SCHED_FIFO was not asked for or not granted"""
    cpu: int | None
    """the one core the thread is bound to"""


class Guarantees(NamedTuple):
    """What holds for the loop: its process's conduct and its thread's rank."""

    process: ProcessConduct
    thread: ThreadRank

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


NOTHING_HOLDS = Guarantees(ProcessConduct(False, False), ThreadRank(0, None))


def prepare_process(priority: int) -> ProcessConduct:
    """Lock memory, freeze and stop the collector, rank the calling thread as an attendant.

    `priority` is the loop's; at 0 nothing is ranked. An attendant has the lowest real-time
    priority, and so has every thread it starts: one of them may hold the interpreter's lock when
    the loop wakes up, and must not be kept from giving it back by programs that matter less.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    if priority > 0:
        _set_fifo(_ATTENDANT_PRIORITY)
    return ProcessConduct(memory_locked=_lock_memory(), collector_off=not gc.isenabled())


def rank_thread(priority: int, cpu: int | None = None) -> ThreadRank:
    """Put the calling thread at `priority`, and on one core."""
    return ThreadRank(
        fifo_priority=priority if priority > 0 and _set_fifo(priority) else 0,
        cpu=cpu if cpu is not None and _bind(cpu) else None,
    )


def release_process() -> None:
    """Give back what other code in this process would miss; for the thread that prepared it."""
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


def _lock_memory() -> bool:
    return bool(ctypes.CDLL(None).mlockall(_MCL_CURRENT | _MCL_FUTURE) == 0)


def _bind(cpu: int) -> bool:
    try:
        os.sched_setaffinity(0, {cpu})
    except (OSError, ValueError, OverflowError):
        return False
    return True
