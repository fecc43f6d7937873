"""Time-keeping of the loop: measures each tick, records it, and explains a late one."""

import os
import resource
import time
from collections.abc import Callable
from enum import StrEnum
from math import ceil, log
from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.timing import PERIOD_NS
from rt_controller.realtime.clock import Clock, ScheduledTick


class TickTimes(NamedTuple):
    """Times of one tick in microseconds; the fields are the columns of `--ticks`."""

    wake_us: float
    """from the scheduled instant until the loop runs; skipped periods included"""
    read_ahead_us: float
    """before the tick: reading the frames that had arrived"""
    receive_us: float
    """reading the frames that arrived since then, and choosing what is fresh and valid"""
    check_us: float
    """the plausibility checks, and the estimate of what they refuse"""
    plan_us: float
    """lifting, expanding the reference, updating the QP and solving it"""
    qp_us: float
    """the solver's part of `plan_us`"""
    decide_us: float
    """choosing the mode and the input, and limiting it"""
    send_us: float
    """packing the frames, and handing them to the bus"""
    step_us: float
    """the five stages together"""
    cpu_us: float
    """the step's time on the processor; in the rest of `step_us` others ran"""
    total_us: float
    """reading ahead and the step: all work between received and sent frames"""
    preparation_us: float
    """before the tick: updating the matrices, and warming up; without reading"""
    preparation_late_us: float
    """computing time of the preparation after the scheduled instant"""
    overrun_us: float
    """how long the step before ran after the scheduled instant of this one"""
    qp_iterations: float
    """0: no QP was solved"""


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
    CHECKING = "the plausibility checks took long"
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
        LateCause.CHECKING: min(times.check_us, computed_us),
        LateCause.COMPUTING: computed_us - times.qp_us - bus_us - times.check_us,
    }
    return max(shares_us, key=lambda cause: shares_us[cause])


def _open(path: str) -> int | None:
    try:
        return os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return None


def _first_line(file: int | None) -> list[bytes]:
    return [] if file is None else os.pread(file, _FIRST_LINE_BYTES, 0).split(b"\n")[0].split()


SOLVE_FIELDS = frozenset({"plan_us", "qp_us", "qp_iterations"})
"""counted only for the ticks that solved a QP"""


LOWEST = 0.1
HIGHEST = 1e9
BUCKET_RATIO = 1.01
"""upper edge of a bucket divided by its lower edge"""
_BUCKETS_PER_E_FOLD = 1.0 / log(BUCKET_RATIO)


class Percentiles(NamedTuple):
    """Percentiles of one quantity over the run; zeros if nothing was recorded."""

    p50: float
    p99: float
    p999: float
    max: float
    mean: float


class Histogram:
    """Counts of values in buckets one per cent wide, and the largest value of each bucket.

    A percentile is a value that was recorded, at most 1 % above the exact one; the maximum is
    exact. Values below `LOWEST` share the first bucket.
    """

    def __init__(self) -> None:
        buckets = ceil(log(HIGHEST / LOWEST) * _BUCKETS_PER_E_FOLD) + 2
        self._counts = np.zeros(buckets, dtype=np.int64)
        self._largest = np.zeros(buckets)
        self._total = 0.0

    def add(self, value: float) -> None:
        """Count one value."""
        if value <= LOWEST:
            bucket = 0
        elif value < HIGHEST:
            bucket = 1 + int(log(value / LOWEST) * _BUCKETS_PER_E_FOLD)
        else:
            bucket = len(self._counts) - 1
        self._counts[bucket] += 1
        self._total += value
        self._largest[bucket] = max(self._largest[bucket], value)

    def percentiles(self) -> Percentiles:
        cumulative = np.cumsum(self._counts)
        total = int(cumulative[-1])
        if total == 0:
            return Percentiles(0.0, 0.0, 0.0, 0.0, 0.0)
        # The smallest value with at least so many per mille of all values at or below it.
        ranks = [-(-total * per_mille // 1000) for per_mille in (500, 990, 999, 1000)]
        p50, p99, p999, most = self._largest[np.searchsorted(cumulative, ranks)].tolist()
        return Percentiles(p50, p99, p999, most, self._total / total)


class WorstTick(NamedTuple):
    """The tick whose frames were sent last after its scheduled instant."""

    tick: int
    """counted from zero"""
    late_us: float
    cause: LateCause


class DeadlineAccount:
    """Percentiles and counts over all ticks, and the times of the last `capacity` ticks.

    A tick misses its deadline if its frames are sent later than `deadline_ns` after its scheduled
    instant. Skipped ticks are counted separately: they sent no frames.
    """

    def __init__(self, capacity: int, deadline_ns: int) -> None:
        self._times = np.zeros((capacity, len(TickTimes._fields)))
        self._histograms = [Histogram() for _ in TickTimes._fields]
        self._deadline_ns = deadline_ns
        self.ticks = 0
        self.deadline_misses = 0
        self.skipped_ticks = 0
        self.missed_last = False
        self.misses_by_cause = dict.fromkeys(LateCause, 0)
        self.worst: WorstTick | None = None

    def record(
        self, times: TickTimes, skipped: int, sent_after_ns: int, cause: LateCause | None = None
    ) -> None:
        """Count one tick, with the reason if it was late, and the periods skipped before it.

        `sent_after_ns` is the time from the scheduled instant until the frames were sent, on the
        loop's clock: simulated time has no lateness.
        """
        self._times[self.ticks % self._times.shape[0]] = times
        for field, value, histogram in zip(TickTimes._fields, times, self._histograms, strict=True):
            if times.qp_iterations > 0.0 or field not in SOLVE_FIELDS:
                histogram.add(value)
        self.ticks += 1
        self.skipped_ticks += skipped
        self.missed_last = sent_after_ns > self._deadline_ns
        self.deadline_misses += self.missed_last
        if cause is None:
            return
        if self.missed_last:
            self.misses_by_cause[cause] += 1
        late_us = sent_after_ns / 1e3
        if self.worst is None or late_us > self.worst.late_us:
            self.worst = WorstTick(self.ticks - 1, late_us, cause)

    def percentiles(self, field: str) -> Percentiles:
        return self._histograms[TickTimes._fields.index(field)].percentiles()

    def last(self) -> Array:
        """(ticks, fields) times of the last ticks, oldest first; columns as `TickTimes`."""
        capacity = self._times.shape[0]
        if self.ticks <= capacity:
            return self._times[: self.ticks]
        return np.roll(self._times, -(self.ticks % capacity), axis=0)


class MeasuredTick(NamedTuple):
    """One tick as the timer recorded it."""

    scheduled_ns: int
    skipped: int
    sent_after_ns: int
    """from the scheduled instant until the frames were sent, skipped periods included"""
    times: TickTimes
    cause: LateCause | None
    """what took the most time, whether the tick was late or not; None without kernel counters"""


class TickTimer:
    """Measures one tick after the other, in the order of its methods.

    With kernel counters the cause of late ticks is recorded too.
    """

    def __init__(
        self, clock: Clock, account: DeadlineAccount, kernel_counters: KernelCounters | None = None
    ) -> None:
        self._clock = clock
        self._account = account
        self._kernel_counters = kernel_counters
        self._tick = ScheduledTick(0, 0, 0)
        self._read_ahead_ns = self._preparation_ns = self._preparation_cpu_ns = 0
        self._prepared_at_ns = 0
        self._stage_ends_ns: list[int] = []
        self._began_cpu_ns = 0
        self._last_sent_at_ns: int | None = None

    def time_reading(self, read_ahead: Callable[[], None]) -> int:
        """Read frames before the tick; the time it took, in ns."""
        took_ns = self._measure(read_ahead)
        self._read_ahead_ns += took_ns
        return took_ns

    def time_preparation(self, action: Callable[[], None]) -> int:
        """Do a part of the preparation before the tick; the time it took, in ns."""
        took_ns = self._measure(action)
        self._preparation_ns += took_ns
        return took_ns

    def wait(self) -> ScheduledTick:
        """Wait for the tick; the first stage of its step begins now."""
        self._prepared_at_ns = self._clock.now_ns()
        self._tick = self._clock.wait()
        self._stage_ends_ns.clear()
        self._stage_ends_ns.append(time.perf_counter_ns())
        self._began_cpu_ns = time.thread_time_ns()
        return self._tick

    def end_stage(self) -> None:
        """The step received, checked, planned or decided; sending is the last stage."""
        self._stage_ends_ns.append(time.perf_counter_ns())

    def record(self, qp_ns: int, qp_iterations: int) -> MeasuredTick:
        """The step has sent its frames: record the tick in the account."""
        self._stage_ends_ns.append(time.perf_counter_ns())
        began_ns, received_ns, checked_ns, planned_ns, decided_ns, sent_ns = self._stage_ends_ns
        cpu_ns = time.thread_time_ns() - self._began_cpu_ns
        sent_at_ns, tick = self._clock.now_ns(), self._tick

        skipped_ns = tick.skipped * PERIOD_NS  # counts as lateness: no frames were sent
        due_ns = tick.scheduled_ns - skipped_ns
        step_ns = sent_ns - began_ns
        overrun_ns = 0 if self._last_sent_at_ns is None else max(0, self._last_sent_at_ns - due_ns)
        # Only computing makes the preparation the cause; its waiting has other causes.
        late_ns = max(0, self._prepared_at_ns - due_ns - overrun_ns)
        times = TickTimes(
            wake_us=(tick.lateness_ns + skipped_ns) / 1e3,
            read_ahead_us=self._read_ahead_ns / 1e3,
            receive_us=(received_ns - began_ns) / 1e3,
            check_us=(checked_ns - received_ns) / 1e3,
            plan_us=(planned_ns - checked_ns) / 1e3,
            qp_us=qp_ns / 1e3,
            decide_us=(decided_ns - planned_ns) / 1e3,
            send_us=(sent_ns - decided_ns) / 1e3,
            step_us=step_ns / 1e3,
            cpu_us=cpu_ns / 1e3,
            total_us=(self._read_ahead_ns + step_ns) / 1e3,
            preparation_us=self._preparation_ns / 1e3,
            preparation_late_us=min(late_ns, self._preparation_cpu_ns) / 1e3,
            overrun_us=overrun_ns / 1e3,
            qp_iterations=qp_iterations,
        )
        self._last_sent_at_ns = sent_at_ns
        self._read_ahead_ns = self._preparation_ns = self._preparation_cpu_ns = 0
        counters = self._kernel_counters
        cause = None if counters is None else late_cause(counters.since_last(), times)
        self._account.record(times, tick.skipped, sent_at_ns - due_ns, cause)
        return MeasuredTick(tick.scheduled_ns, tick.skipped, sent_at_ns - due_ns, times, cause)

    def _measure(self, action: Callable[[], None]) -> int:
        began_ns, began_cpu_ns = time.perf_counter_ns(), time.thread_time_ns()
        action()
        self._preparation_cpu_ns += time.thread_time_ns() - began_cpu_ns
        return time.perf_counter_ns() - began_ns
