"""The cause of a late tick, from its times and from what the kernel counted during it."""

import os
import resource
from enum import StrEnum
from typing import NamedTuple

from rt_controller.realtime.tick_times import TickTimes

_FIRST_LINE_BYTES = 256
_STEAL_COLUMN = 8
"""of the first line of /proc/stat: time that the host gave to other machines"""


class LateCause(StrEnum):
    """What took most of a late tick's time."""

    HOST = (
        "this process was stopped, or this machine did not run: the host ran others (steal), or a "
        "deep sleep state"
    )
    PREEMPTED = "another thread had the core"
    PAGE_FAULT = "memory had to be read from disk"
    SOLVER = "the QP took long"
    BUS = "reading or sending frames took long"
    COMPUTING = "the rest of the step took long"
    PREPARING = "the preparation of its plan was not done in time"
    OVERRUN = "the step before it took too long"


class Counts(NamedTuple):
    """What the kernel counted for one thread and its machine between two readings."""

    waited_ns: int
    """time in which the thread was ready to run, but another one ran"""
    major_faults: int
    steal_ticks: int
    """of the machine"""


class KernelCounters:
    """Reads the counters of the thread that created it; a reading takes a few microseconds.

    A counter that the system does not have (no /proc) stays zero.
    """

    def __init__(self) -> None:
        self._schedstat = _open("/proc/thread-self/schedstat")
        self._stat = _open("/proc/stat")
        self._last = self._read()

    def since_last(self) -> Counts:
        """The counts since the last call, or since the start."""
        last, self._last = self._last, self._read()
        return Counts(*(new - old for new, old in zip(self._last, last, strict=True)))

    def _read(self) -> Counts:
        schedstat, stat = _first_line(self._schedstat), _first_line(self._stat)
        return Counts(
            waited_ns=int(schedstat[1]) if len(schedstat) > 1 else 0,
            major_faults=resource.getrusage(resource.RUSAGE_THREAD).ru_majflt,
            steal_ticks=int(stat[_STEAL_COLUMN]) if len(stat) > _STEAL_COLUMN else 0,
        )

    def close(self) -> None:
        for file in (self._schedstat, self._stat):
            if file is not None:
                os.close(file)


def late_cause(counts: Counts, times: TickTimes) -> LateCause:
    """What took most of a tick's time; `counts` are those of the tick."""
    if counts.major_faults > 0:
        return LateCause.PAGE_FAULT
    if counts.steal_ticks > 0:
        return LateCause.HOST
    computed_us = min(times.cpu_us, times.step_us)
    waited_us = counts.waited_ns / 1e3
    own_us = computed_us + times.preparation_late_us + times.overrun_us
    bus_us = times.receive_us + times.send_us
    shares_us = {
        LateCause.HOST: times.wake_us + times.step_us - own_us - waited_us,
        LateCause.PREPARING: times.preparation_late_us,
        LateCause.OVERRUN: times.overrun_us,
        LateCause.PREEMPTED: waited_us,
        LateCause.SOLVER: min(times.qp_us, computed_us),
        LateCause.BUS: min(bus_us, computed_us),
        LateCause.COMPUTING: computed_us - times.qp_us - bus_us,
    }
    return max(shares_us, key=lambda cause: shares_us[cause])


def _open(path: str) -> int | None:
    try:
        return os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return None


def _first_line(file: int | None) -> list[bytes]:
    return [] if file is None else os.pread(file, _FIRST_LINE_BYTES, 0).split(b"\n")[0].split()
