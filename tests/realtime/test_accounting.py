"""Every tick is counted, in memory that does not grow."""

import tracemalloc

import numpy as np

from rt_controller.realtime.timing import DeadlineAccount, LateCause, TickTimes

DEADLINE_NS = 10_000_000


def times(step_us: float = 900.0, qp_us: float = 80.0, qp_iterations: float = 5) -> TickTimes:
    zeros = TickTimes(*(0.0 for _ in TickTimes._fields))
    return zeros._replace(
        step_us=step_us, qp_us=qp_us, plan_us=qp_us + 20.0, qp_iterations=qp_iterations
    )


def make_account(capacity: int = 10) -> DeadlineAccount:
    return DeadlineAccount(capacity, DEADLINE_NS)


def test_a_deadline_counts_from_the_scheduled_instant() -> None:
    account = make_account()
    account.record(times(), 0, sent_after_ns=DEADLINE_NS)
    assert (account.deadline_misses, account.missed_last) == (0, False)
    account.record(times(), 0, sent_after_ns=DEADLINE_NS + 1)
    assert (account.deadline_misses, account.missed_last) == (1, True)
    account.record(times(), 0, sent_after_ns=0)
    assert (account.deadline_misses, account.missed_last) == (1, False)


def test_counts_and_percentiles_are_of_all_ticks_when_the_ring_is_full() -> None:
    account = make_account(capacity=4)
    for n in range(1, 11):
        account.record(times(step_us=float(n)), skipped=n % 2, sent_after_ns=0)
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


def test_percentiles_of_solves_leave_out_ticks_without_a_solve() -> None:
    account = make_account()
    account.record(times(qp_us=0.0, qp_iterations=0), 0, 0)
    account.record(times(qp_us=80.0, qp_iterations=9), 0, 0)
    assert account.percentiles("qp_us").p50 == 80.0
    assert account.percentiles("plan_us").p50 == 100.0
    assert account.percentiles("qp_iterations").p50 == 9.0


def test_the_worst_tick_and_every_missed_deadline_have_a_cause() -> None:
    account = make_account()
    account.record(times(), 0, 900_000, LateCause.COMPUTING)
    account.record(times(), 0, 800_000, LateCause.BUS)
    account.record(times(), 0, DEADLINE_NS + 5_000, LateCause.HOST)
    account.record(times(), 0, DEADLINE_NS + 4_000, LateCause.PREEMPTED)
    assert account.worst == (2, DEADLINE_NS / 1e3 + 5.0, LateCause.HOST)
    assert account.misses_by_cause[LateCause.HOST] == 1
    assert account.misses_by_cause[LateCause.PREEMPTED] == 1
    assert account.misses_by_cause[LateCause.COMPUTING] == 0


def test_the_memory_of_an_account_does_not_grow_with_the_ticks() -> None:
    account = make_account(capacity=100)
    rng = np.random.default_rng(0)
    ticks = [times(step_us=step_us) for step_us in rng.lognormal(5.0, 1.0, size=3_000)]
    for tick in ticks[:100]:
        account.record(tick, 0, 0)
    tracemalloc.start()
    for tick in ticks:
        account.record(tick, 0, 0)
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert grown < 2_000
