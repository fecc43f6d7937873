"""Why a tick was late: what the system counted while it went on."""

import os
import resource
from enum import StrEnum
from typing import NamedTuple

_FIRST_LINE_BYTES = 256
_STEAL = 8
"""column of /proc/stat's first line: time that the host gave to other machines"""


class Cause(StrEnum):
    """Where most of a late tick's time went."""

    HOST = "the machine stood still: the host ran others (steal), or a sleep state took long"
    PREEMPTED = "another thread had the core"
    PAGE_FAULT = "memory had to be read from disk"
    SOLVER = "the QP took long"
    BUS = "reading or sending frames took long"
    COMPUTING = "the rest of the step took long"
    PREPARING = "the preparation of its plan was not done in time"
    OVERRUN = "the step before it took too long"


class Sight(NamedTuple):
    """Counters of this thread and machine, all of them growing."""

    waited_ns: int
    """this thread ready to run, and another one running"""
    major_faults: int
    steal_ticks: int
    """of this machine, since it was started"""


class TickParts(NamedTuple):
    """Where one tick's time went, in microseconds."""

    wake_us: float
    step_us: float
    cpu_us: float
    """what of the step was this thread's computing"""
    qp_us: float
    bus_us: float
    prepared_late_us: float
    """what the preparation computed beyond its time"""
    overrun_us: float
    """what the step before took beyond this one's instant"""


class Witness:
    """Reads the counters of the thread that made it; a few microseconds a look.

    Where the system does not say (no /proc), a counter stays zero and is no cause.
    """

    def __init__(self) -> None:
        self._schedule = _open("/proc/thread-self/schedstat")
        self._machine = _open("/proc/stat")

    def look(self) -> Sight:
        """The counters now."""
        schedule = _read(self._schedule)
        machine = _read(self._machine)
        return Sight(
            waited_ns=int(schedule[1]) if len(schedule) > 1 else 0,
            major_faults=resource.getrusage(resource.RUSAGE_THREAD).ru_majflt,
            steal_ticks=int(machine[_STEAL]) if len(machine) > _STEAL else 0,
        )

    def close(self) -> None:
        """Release what is held open."""
        for file in (self._schedule, self._machine):
            if file is not None:
                os.close(file)


def explain(before: Sight, after: Sight, parts: TickParts) -> Cause:
    """What took most of a tick's time between two looks."""
    if after.major_faults > before.major_faults:
        return Cause.PAGE_FAULT
    if after.steal_ticks > before.steal_ticks:
        return Cause.HOST
    computed_us = min(parts.cpu_us, parts.step_us)
    waited_us = (after.waited_ns - before.waited_ns) / 1e3
    own_us = computed_us + parts.prepared_late_us + parts.overrun_us
    shares = {
        Cause.HOST: parts.wake_us + parts.step_us - own_us - waited_us,
        Cause.PREPARING: parts.prepared_late_us,
        Cause.OVERRUN: parts.overrun_us,
        Cause.PREEMPTED: waited_us,
        Cause.SOLVER: min(parts.qp_us, computed_us),
        Cause.BUS: min(parts.bus_us, computed_us),
        Cause.COMPUTING: computed_us - parts.qp_us - parts.bus_us,
    }
    return max(shares, key=lambda cause: shares[cause])


def _open(path: str) -> int | None:
    try:
        return os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return None


def _read(file: int | None) -> list[bytes]:
    return [] if file is None else os.pread(file, _FIRST_LINE_BYTES, 0).split(b"\n")[0].split()
