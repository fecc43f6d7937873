"""Time-keeping of the loop: measures each tick, records it, and explains a late one."""

import os
import time
from collections.abc import Callable
from contextlib import suppress
from enum import StrEnum
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


class LateCause(StrEnum):
    """What took most of a late tick's time."""

    HOST = (
        "this process was stopped, or this machine did not run: the host ran others, or a deep "
        "sleep state"
    )
    PREEMPTED = "another thread had the core"
    SOLVER = "the QP took long"
    COMPUTING = "the rest of the step, its preparation, or the step before it took long"


class KernelCounters:
    """Reads how long the thread that created it was ready to run while another one ran.

    A reading takes a few microseconds. Always 0 on a system without /proc.
    """

    def __init__(self) -> None:
        self._file: int | None = None
        with suppress(OSError):
            self._file = os.open("/proc/thread-self/schedstat", os.O_RDONLY | os.O_CLOEXEC)
        self._waited_ns = self._read()

    def waited_ns(self) -> int:
        """Time since the last call, or since the start."""
        last_ns, self._waited_ns = self._waited_ns, self._read()
        return self._waited_ns - last_ns

    def _read(self) -> int:
        return 0 if self._file is None else int(os.pread(self._file, 64, 0).split()[1])

    def close(self) -> None:
        if self._file is not None:
            os.close(self._file)


def late_cause(waited_ns: int, times: TickTimes) -> LateCause:
    """What took most of a tick's time, in which the thread waited so long for its core."""
    computed_us = min(times.cpu_us, times.step_us)
    before_us, waited_us = times.preparation_late_us + times.overrun_us, waited_ns / 1e3
    shares_us = {
        LateCause.HOST: times.wake_us + times.step_us - computed_us - before_us - waited_us,
        LateCause.PREEMPTED: waited_us,
        LateCause.SOLVER: min(times.qp_us, computed_us),
        LateCause.COMPUTING: computed_us - times.qp_us + before_us,
    }
    return max(shares_us, key=lambda cause: shares_us[cause])


_OF_SOLVES = frozenset({"plan_us", "qp_us", "qp_iterations"})
"""counted only for the ticks that solved a QP"""


class Percentiles(NamedTuple):
    """Percentiles of one quantity; zeros if nothing was recorded."""

    p50: float
    p99: float
    p999: float
    max: float
    mean: float


def percentiles_of(times: Array, field: str) -> Percentiles:
    """Percentiles of a column of times (ticks, fields); each is a value that was recorded."""
    values = times[:, TickTimes._fields.index(field)]
    if field in _OF_SOLVES:
        values = values[times[:, TickTimes._fields.index("qp_iterations")] > 0.0]
    if not len(values):
        return Percentiles(0.0, 0.0, 0.0, 0.0, 0.0)
    found = np.quantile(values, (0.5, 0.99, 0.999, 1.0), method="inverted_cdf")
    p50, p99, p999, most = found.tolist()
    return Percentiles(p50, p99, p999, most, float(values.mean()))


class WorstTick(NamedTuple):
    """The tick whose frames were sent last after its scheduled instant."""

    tick: int
    """counted from zero"""
    late_us: float
    cause: LateCause


class DeadlineAccount:
    """Counts over all ticks, and the times of the last `capacity` ticks with their percentiles.

    A tick misses its deadline if its frames are sent later than `deadline_ns` after its scheduled
    instant. Skipped ticks are counted separately: they sent no frames.
    """

    def __init__(self, capacity: int, deadline_ns: int) -> None:
        self._times = np.zeros((capacity, len(TickTimes._fields)))
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
        """Of the last `capacity` ticks."""
        return percentiles_of(self._times[: self.ticks], field)

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
        cause = None if counters is None else late_cause(counters.waited_ns(), times)
        self._account.record(times, tick.skipped, sent_at_ns - due_ns, cause)
        return MeasuredTick(tick.scheduled_ns, tick.skipped, sent_at_ns - due_ns, times, cause)

    def _measure(self, action: Callable[[], None]) -> int:
        began_ns, began_cpu_ns = time.perf_counter_ns(), time.thread_time_ns()
        action()
        self._preparation_cpu_ns += time.thread_time_ns() - began_cpu_ns
        return time.perf_counter_ns() - began_ns
