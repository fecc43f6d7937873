"""Times of ticks on scripted clocks; every tick is counted, in memory that does not grow."""

import tracemalloc

import numpy as np
import pytest

from rt_controller.contract.timing import PERIOD_NS
from rt_controller.realtime import timing
from rt_controller.realtime.clock import ScheduledTick
from rt_controller.realtime.timing import (
    DeadlineAccount,
    LateCause,
    TickTimer,
    TickTimes,
    late_cause,
)

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
    """The thread never waits for its core: nothing but the loop itself takes time."""

    def waited_ns(self) -> int:
        return 0


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


def test_the_stages_of_a_step_are_measured_separately(time, account):
    run_tick(time, TickTimer(time, account))
    found = last(account)
    assert (found.receive_us, found.check_us, found.plan_us) == (50.0, 20.0, 300.0)
    assert (found.decide_us, found.send_us) == (10.0, 40.0)
    assert (found.qp_us, found.qp_iterations) == (100.0, 7.0)
    assert (found.step_us, found.cpu_us) == (420.0, 210.0)


def test_work_before_a_tick_counts_for_that_tick_only(time, account):
    timer = TickTimer(time, account)
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


def test_a_step_longer_than_a_period_is_the_overrun_of_the_next_tick(time, account):
    timer = TickTimer(time, account, ScriptedCounters())
    run_tick(time, timer, plan_us=60_000)
    assert account.deadline_misses == 1
    run_tick(time, timer)
    found = last(account)
    late_us = 60_120.0 - PERIOD_NS / US
    assert (found.wake_us, found.overrun_us) == (late_us, late_us)
    assert (account.skipped_ticks, account.deadline_misses) == (1, 2)
    assert account.misses_by_cause[LateCause.COMPUTING] == 1


def test_a_late_preparation_counts_with_its_time_on_the_processor(time, account):
    timer = TickTimer(time, account)
    run_tick(time, timer)
    run_tick(time, timer, prepare_us=40_000)
    found = last(account)
    assert found.wake_us == 420.0 + 40_000.0 - PERIOD_NS / US
    assert found.preparation_late_us == min(found.wake_us, PROCESSOR_SHARE * 40_000.0)


DEADLINE_NS = 10_000_000


def times(step_us: float = 900.0, qp_us: float = 80.0, qp_iterations: float = 5) -> TickTimes:
    zeros = TickTimes(*(0.0 for _ in TickTimes._fields))
    return zeros._replace(
        step_us=step_us, qp_us=qp_us, plan_us=qp_us + 20.0, qp_iterations=qp_iterations
    )


def make_account(capacity: int = 10) -> DeadlineAccount:
    return DeadlineAccount(capacity, DEADLINE_NS)


def test_a_deadline_counts_from_the_scheduled_instant():
    account = make_account()
    account.record(times(), 0, sent_after_ns=DEADLINE_NS)
    assert (account.deadline_misses, account.missed_last) == (0, False)
    account.record(times(), 0, sent_after_ns=DEADLINE_NS + 1)
    assert (account.deadline_misses, account.missed_last) == (1, True)
    account.record(times(), 0, sent_after_ns=0)
    assert (account.deadline_misses, account.missed_last) == (1, False)


def test_the_ring_has_the_last_ticks_oldest_first():
    account = make_account(capacity=4)
    step = TickTimes._fields.index("step_us")
    for n in range(3):
        account.record(times(step_us=float(n)), 0, 0)
    np.testing.assert_array_equal(account.last()[:, step], [0.0, 1.0, 2.0])
    for n in range(3, 10):
        account.record(times(step_us=float(n)), 0, 0)
    np.testing.assert_array_equal(account.last()[:, step], [6.0, 7.0, 8.0, 9.0])
    assert (account.ticks, account.percentiles("step_us").max) == (10, 9.0)


def test_the_worst_tick_and_every_missed_deadline_have_a_cause():
    account = make_account()
    account.record(times(), 0, 900_000, LateCause.COMPUTING)
    account.record(times(), 0, 800_000, LateCause.SOLVER)
    account.record(times(), 0, DEADLINE_NS + 5_000, LateCause.HOST)
    account.record(times(), 0, DEADLINE_NS + 4_000, LateCause.PREEMPTED)
    assert account.worst == (2, DEADLINE_NS / 1e3 + 5.0, LateCause.HOST)
    assert account.misses_by_cause[LateCause.HOST] == 1
    assert account.misses_by_cause[LateCause.PREEMPTED] == 1
    assert account.misses_by_cause[LateCause.COMPUTING] == 0


def test_the_memory_of_an_account_does_not_grow_with_the_ticks():
    account = make_account(capacity=100)
    rng = np.random.default_rng(0)
    ticks = [times(step_us=step_us) for step_us in rng.lognormal(5.0, 1.0, size=1_000)]
    for tick in ticks[:100]:
        account.record(tick, 0, 0)
    tracemalloc.start()
    for tick in ticks:
        account.record(tick, 0, 0)
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert grown < 2_000


def test_a_percentile_is_a_recorded_value_and_solves_are_those_of_ticks_with_one():
    account = make_account(capacity=2_000)
    assert account.percentiles("step_us") == (0.0,) * 5
    values = np.random.default_rng(0).lognormal(5.0, 1.5, size=1_000)
    for value in values:
        account.record(times(step_us=value, qp_us=value, qp_iterations=5 * (value > 100.0)), 0, 0)
    exact = np.sort(values)[[499, 989, 998, 999]]
    assert account.percentiles("step_us") == pytest.approx((*exact, values.mean()), rel=1e-12)
    assert account.percentiles("qp_us").mean == pytest.approx(values[values > 100.0].mean())


QUIET = TickTimes(*(0.0 for _ in TickTimes._fields))._replace(
    wake_us=50.0, step_us=400.0, cpu_us=400.0, qp_us=100.0, receive_us=50.0, send_us=30.0
)
BUSY = QUIET._replace(step_us=9_000.0, cpu_us=9_000.0)


@pytest.mark.parametrize(
    ("waited_us", "times", "cause"),
    [
        (0.0, QUIET._replace(wake_us=9_000.0), LateCause.HOST),
        (0.0, QUIET._replace(step_us=9_000.0), LateCause.HOST),
        (8_500.0, QUIET._replace(wake_us=9_000.0), LateCause.PREEMPTED),
        (8_500.0, QUIET._replace(step_us=9_000.0), LateCause.PREEMPTED),
        (0.0, QUIET._replace(wake_us=9_000.0, preparation_late_us=8_900.0), LateCause.COMPUTING),
        (0.0, QUIET._replace(wake_us=49_000.0, overrun_us=48_000.0), LateCause.COMPUTING),
        (0.0, BUSY._replace(qp_us=8_000.0), LateCause.SOLVER),
        (0.0, BUSY._replace(receive_us=8_000.0), LateCause.COMPUTING),
        (0.0, BUSY, LateCause.COMPUTING),
    ],
)
def test_the_largest_share_is_the_cause(waited_us, times, cause):
    assert late_cause(round(1e3 * waited_us), times) is cause
