"""Asking the operating system for real-time conduct, and saying what it granted."""

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


class Guarantees(NamedTuple):
    """What holds for the calling thread and its process."""

    fifo_priority: int
    """0: SCHED_FIFO was not asked for or not granted"""
    memory_locked: bool
    collector_off: bool
    cpu: int | None
    """the one core the thread is bound to"""

    @property
    def scheduler(self) -> str:
        return f"SCHED_FIFO {self.fifo_priority}" if self.fifo_priority else "SCHED_OTHER"

    def sentence(self) -> str:
        """One line for the terminal and the log."""
        memory = "memory locked" if self.memory_locked else "memory NOT locked"
        collector = "collector off" if self.collector_off else "collector ON"
        core = "any core" if self.cpu is None else f"core {self.cpu}"
        return f"{self.scheduler}, {memory}, {collector}, {core}"


def acquire(priority: int, cpu: int | None) -> Guarantees:
    """What could be had for the calling thread; nothing here is fatal.

    Memory is locked and the collector frozen for the whole process. Scheduler and core count for
    the calling thread alone, so the loop asks for itself and for nobody else.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    return Guarantees(
        fifo_priority=priority if priority > 0 and _set_fifo(priority) else 0,
        memory_locked=_lock_memory(),
        collector_off=not gc.isenabled(),
        cpu=cpu if cpu is not None and _bind(cpu) else None,
    )


def attend(priority: int) -> bool:
    """Whether the calling thread, and every thread it starts, now has the lowest real-time rank.

    For the threads beside the loop: one of them may hold the interpreter's lock when the loop
    wakes up, and must not be kept from giving it back by programs that matter less than both.
    """
    return priority > 0 and _set_fifo(_ATTENDANT_PRIORITY)


def release() -> None:
    """Give back what other code in this process would miss: the collector and the scheduler."""
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
    except (OSError, ValueError):
        return False
    return True
