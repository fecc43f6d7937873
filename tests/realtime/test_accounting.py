"""Every tick is accounted for, in memory that does not grow."""

import tracemalloc

import numpy as np

from rt_controller.realtime.accounting import DeadlineAccount, TickTimes
from rt_controller.realtime.lateness import Cause

DEADLINE_NS = 10_000_000


def times(step_us: float = 900.0, qp_us: float = 80.0, qp_iterations: float = 5) -> TickTimes:
    return TickTimes(
        wake_us=100.0,
        listen_us=90.0,
        hear_us=50.0,
        plan_us=qp_us + 20.0,
        qp_us=qp_us,
        answer_us=60.0,
        step_us=step_us,
        cpu_us=0.9 * step_us,
        whole_us=90.0 + step_us,
        prepare_us=400.0,
        qp_iterations=qp_iterations,
    )


def make_account(capacity: int = 10) -> DeadlineAccount:
    return DeadlineAccount(capacity, DEADLINE_NS)


def test_a_deadline_counts_from_the_scheduled_instant() -> None:
    account = make_account()
    account.record(times(), 0, done_after_ns=DEADLINE_NS)
    assert (account.deadline_misses, account.missed_last) == (0, False)
    account.record(times(), 0, done_after_ns=DEADLINE_NS + 1)
    assert (account.deadline_misses, account.missed_last) == (1, True)
    account.record(times(), 0, done_after_ns=0)
    assert (account.deadline_misses, account.missed_last) == (1, False)


def test_counts_and_percentiles_are_of_all_ticks_when_the_ring_is_full() -> None:
    account = make_account(capacity=4)
    for n in range(1, 11):
        account.record(times(step_us=float(n)), skipped=n % 2, done_after_ns=0)
    assert account.ticks == 10
    assert account.skipped_ticks == 5
    assert account.percentiles("step_us").max == 10.0
    assert account.percentiles("step_us").p50 == 5.0


def test_the_ring_has_the_last_ticks_oldest_first() -> None:
    account = make_account(capacity=4)
    step = TickTimes._fields.index("step_us")
    for n in range(3):
        account.record(times(step_us=float(n)), 0, 0)
    np.testing.assert_array_equal(account.last()[:, step], [0.0, 1.0, 2.0])
    for n in range(3, 10):
        account.record(times(step_us=float(n)), 0, 0)
    np.testing.assert_array_equal(account.last()[:, step], [6.0, 7.0, 8.0, 9.0])


def test_ticks_without_a_solve_do_not_count_as_fast_solves() -> None:
    account = make_account()
    account.record(times(qp_us=0.0, qp_iterations=0), 0, 0)
    account.record(times(qp_us=80.0, qp_iterations=9), 0, 0)
    assert account.percentiles("qp_us").p50 == 80.0
    assert account.percentiles("plan_us").p50 == 100.0
    assert account.percentiles("qp_iterations").p50 == 9.0


def test_the_worst_tick_and_every_miss_have_a_cause() -> None:
    account = make_account()
    assert account.record(times(), 0, done_after_ns=900_000)
    account.explain(Cause.COMPUTING)
    assert not account.record(times(), 0, done_after_ns=800_000)
    assert account.record(times(), 0, done_after_ns=DEADLINE_NS + 5_000)
    account.explain(Cause.HOST)
    assert account.record(times(), 0, done_after_ns=DEADLINE_NS + 4_000)
    account.explain(Cause.PREEMPTED)
    assert account.worst == (2, DEADLINE_NS / 1e3 + 5.0, Cause.HOST)
    assert account.misses_by_cause[Cause.HOST] == account.misses_by_cause[Cause.PREEMPTED] == 1
    assert account.misses_by_cause[Cause.COMPUTING] == 0


def test_an_account_of_a_day_is_as_large_as_one_of_a_minute() -> None:
    account = make_account(capacity=100)
    rng = np.random.default_rng(0)
    steps_us = rng.lognormal(5.0, 1.0, size=5_000)
    for step_us in steps_us[:100]:
        account.record(times(step_us=step_us), 0, 0)
    tracemalloc.start()
    for step_us in steps_us:
        account.record(times(step_us=step_us), 0, 0)
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert grown < 2_000
