"""The times of a tick, measured on scripted clocks."""

import pytest

from rt_controller.contract.timing import PERIOD_NS
from rt_controller.realtime import timing
from rt_controller.realtime.clock import ScheduledTick
from rt_controller.realtime.timing import Counts, DeadlineAccount, LateCause, TickTimer, TickTimes

US = 1_000
PROCESSOR_SHARE = 0.5


class ScriptedTime:
    """A clock that moves only when work is done; half of the work is time on the processor."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.ns = 0
        self.next_ns = 0
        monkeypatch.setattr(timing.time, "perf_counter_ns", self.now_ns)
        monkeypatch.setattr(timing.time, "thread_time_ns", lambda: int(PROCESSOR_SHARE * self.ns))

    def now_ns(self) -> int:
        return self.ns

    def work(self, duration_us: int) -> None:
        self.ns += duration_us * US

    def wait(self) -> ScheduledTick:
        skipped = max(0, (self.ns - self.next_ns) // PERIOD_NS)
        scheduled_ns = self.next_ns + skipped * PERIOD_NS
        self.ns = max(self.ns, scheduled_ns)
        self.next_ns = scheduled_ns + PERIOD_NS
        return ScheduledTick(scheduled_ns, self.ns - scheduled_ns, skipped)


class ScriptedCounters:
    """Kernel counters that do not change: nothing but the loop itself takes time."""

    def since_last(self) -> Counts:
        return Counts(0, 0, 0)


@pytest.fixture
def time(monkeypatch: pytest.MonkeyPatch) -> ScriptedTime:
    return ScriptedTime(monkeypatch)


@pytest.fixture
def account() -> DeadlineAccount:
    return DeadlineAccount(10, 10_000 * US)


def run_tick(time: ScriptedTime, timer: TickTimer, plan_us: int = 300, prepare_us: int = 0) -> None:
    timer.time_preparation(lambda: time.work(prepare_us))
    timer.wait()
    for stage_us in (50, 20, plan_us, 10):
        time.work(stage_us)
        timer.end_stage()
    time.work(40)
    timer.record(qp_ns=100 * US, qp_iterations=7)


def last(account: DeadlineAccount) -> TickTimes:
    return TickTimes(*account.last()[-1])


def test_the_stages_of_a_step_are_measured_separately(
    time: ScriptedTime, account: DeadlineAccount
) -> None:
    run_tick(time, TickTimer(time, account))  # type: ignore[arg-type]
    found = last(account)
    assert (found.receive_us, found.check_us, found.plan_us) == (50.0, 20.0, 300.0)
    assert (found.decide_us, found.send_us) == (10.0, 40.0)
    assert (found.qp_us, found.qp_iterations) == (100.0, 7.0)
    assert (found.step_us, found.cpu_us) == (420.0, 210.0)


def test_work_before_a_tick_counts_for_that_tick_only(
    time: ScriptedTime, account: DeadlineAccount
) -> None:
    timer = TickTimer(time, account)  # type: ignore[arg-type]
    run_tick(time, timer)
    assert timer.time_preparation(lambda: time.work(700)) == 700 * US
    assert timer.time_reading(lambda: time.work(60)) == 60 * US
    run_tick(time, timer)
    found = last(account)
    assert (found.preparation_us, found.read_ahead_us) == (700.0, 60.0)
    assert found.total_us == 60.0 + found.step_us
    run_tick(time, timer)
    found = last(account)
    assert (found.preparation_us, found.read_ahead_us) == (0.0, 0.0)


def test_a_step_longer_than_a_period_is_the_overrun_of_the_next_tick(
    time: ScriptedTime, account: DeadlineAccount
) -> None:
    timer = TickTimer(time, account, ScriptedCounters())  # type: ignore[arg-type]
    run_tick(time, timer, plan_us=60_000)
    assert account.deadline_misses == 1
    run_tick(time, timer)
    found = last(account)
    late_us = 60_120.0 - PERIOD_NS / US
    assert (found.wake_us, found.overrun_us) == (late_us, late_us)
    assert (account.skipped_ticks, account.deadline_misses) == (1, 2)
    assert account.misses_by_cause[LateCause.OVERRUN] == 1


def test_a_late_preparation_counts_with_its_time_on_the_processor(
    time: ScriptedTime, account: DeadlineAccount
) -> None:
    timer = TickTimer(time, account)  # type: ignore[arg-type]
    run_tick(time, timer)
    run_tick(time, timer, prepare_us=40_000)
    found = last(account)
    assert found.wake_us == 420.0 + 40_000.0 - PERIOD_NS / US
    assert found.preparation_late_us == min(found.wake_us, PROCESSOR_SHARE * 40_000.0)
