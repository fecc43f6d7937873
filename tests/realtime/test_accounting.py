"""Every tick is accounted for, in memory that does not grow."""

import numpy as np

from rt_controller.realtime.accounting import DeadlineAccount, TickTimes, percentiles

TIMES = TickTimes(wake_us=100.0, step_us=900.0, qp_us=1.0, qp_iterations=5)


def test_a_deadline_counts_from_the_scheduled_instant() -> None:
    account = DeadlineAccount(capacity=10, deadline_ns=10_000_000)
    account.record(TIMES, 0, done_after_ns=10_000_000)
    assert (account.deadline_misses, account.missed_last) == (0, False)
    account.record(TIMES, 0, done_after_ns=10_000_001)
    assert (account.deadline_misses, account.missed_last) == (1, True)
    account.record(TIMES, 0, done_after_ns=0)
    assert (account.deadline_misses, account.missed_last) == (1, False)


def test_counts_go_on_when_the_ring_is_full() -> None:
    account = DeadlineAccount(capacity=4, deadline_ns=10_000_000)
    for n in range(10):
        account.record(TickTimes(0.0, float(n), 0.0, 0), skipped=n % 2, done_after_ns=0)
    assert account.ticks == 10
    assert account.skipped_ticks == 5
    assert account.percentiles("step_us").max == 9.0
    assert account.percentiles("step_us").p50 >= 6.0


def test_ticks_without_a_solve_do_not_count_as_fast_solves() -> None:
    account = DeadlineAccount(capacity=4, deadline_ns=10_000_000)
    account.record(TickTimes(0.0, 5.0, 0.0, 0), 0, 0)
    account.record(TickTimes(0.0, 5.0, 80.0, 9), 0, 0)
    assert account.percentiles("qp_us").p50 == 80.0
    assert account.percentiles("qp_iterations").p50 == 9.0


def test_upper_percentiles_are_values_that_occurred() -> None:
    p = percentiles(np.arange(1000.0))
    assert (p.p99, p.p999, p.max) == (990.0, 999.0, 999.0)
    assert percentiles(np.empty(0)) == (0.0, 0.0, 0.0, 0.0)
