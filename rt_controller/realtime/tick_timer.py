"""Time-keeping of the loop: measures each tick and records it."""

import time
from collections.abc import Callable
from typing import NamedTuple

from rt_controller.contract.timing import PERIOD_NS
from rt_controller.realtime.accounting import DeadlineAccount
from rt_controller.realtime.clock import Clock, Tick
from rt_controller.realtime.kernel_counters import KernelCounters, LateCause, late_cause
from rt_controller.realtime.tick_times import TickTimes


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
        self._tick = Tick(0, 0, 0)
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

    def wait(self) -> Tick:
        """Wait for the tick; the first stage of its step begins now."""
        self._prepared_at_ns = self._clock.now_ns()
        self._tick = self._clock.wait()
        self._stage_ends_ns.clear()
        self._stage_ends_ns.append(time.perf_counter_ns())
        self._began_cpu_ns = time.thread_time_ns()
        return self._tick

    def end_stage(self) -> None:
        """The step received, planned or sent."""
        self._stage_ends_ns.append(time.perf_counter_ns())

    def record(self, qp_ns: int, qp_iterations: int) -> MeasuredTick:
        """The step has sent its frames: record the tick in the account."""
        began_ns, received_ns, planned_ns, sent_ns = (*self._stage_ends_ns, time.perf_counter_ns())
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
            plan_us=(planned_ns - received_ns) / 1e3,
            qp_us=qp_ns / 1e3,
            send_us=(sent_ns - planned_ns) / 1e3,
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
