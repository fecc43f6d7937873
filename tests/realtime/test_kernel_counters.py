"""The cause of a late tick is what took most of its time."""

import pytest

from rt_controller.realtime.timing import Counts, KernelCounters, LateCause, TickTimes, late_cause

QUIET = TickTimes(*(0.0 for _ in TickTimes._fields))._replace(
    wake_us=50.0, step_us=400.0, cpu_us=400.0, qp_us=100.0, receive_us=50.0, send_us=30.0
)
BUSY = QUIET._replace(step_us=9_000.0, cpu_us=9_000.0)


def counted(waited_us: float = 0.0, faults: int = 0, steal: int = 0) -> Counts:
    return Counts(round(1e3 * waited_us), faults, steal)


@pytest.mark.parametrize(
    ("counts", "times", "cause"),
    [
        (counted(), QUIET._replace(wake_us=9_000.0), LateCause.HOST),
        (counted(), QUIET._replace(step_us=9_000.0), LateCause.HOST),
        (counted(steal=1), BUSY, LateCause.HOST),
        (counted(waited_us=8_500.0), QUIET._replace(wake_us=9_000.0), LateCause.PREEMPTED),
        (counted(waited_us=8_500.0), QUIET._replace(step_us=9_000.0), LateCause.PREEMPTED),
        (
            counted(),
            QUIET._replace(wake_us=9_000.0, preparation_late_us=8_900.0),
            LateCause.PREPARING,
        ),
        (counted(), QUIET._replace(wake_us=49_000.0, overrun_us=48_000.0), LateCause.OVERRUN),
        (counted(faults=1), QUIET._replace(step_us=9_000.0), LateCause.PAGE_FAULT),
        (counted(), BUSY._replace(qp_us=8_000.0), LateCause.SOLVER),
        (counted(), BUSY._replace(receive_us=8_000.0), LateCause.BUS),
        (counted(), BUSY._replace(check_us=8_000.0), LateCause.CHECKING),
        (counted(), BUSY, LateCause.COMPUTING),
    ],
)
def test_the_largest_share_is_the_cause(counts: Counts, times: TickTimes, cause: LateCause) -> None:
    assert late_cause(counts, times) is cause


def test_kernel_counters_never_decrease() -> None:
    kernel_counters = KernelCounters()
    try:
        readings = [kernel_counters.since_last() for _ in range(3)]
    finally:
        kernel_counters.close()
    assert all(count >= 0 for counts in readings for count in counts)


def test_counts_are_those_since_the_last_reading(monkeypatch: pytest.MonkeyPatch) -> None:
    waited_ns = iter([1_000, 1_000, 1_250, 1_600])
    monkeypatch.setattr(KernelCounters, "_read", lambda _: Counts(next(waited_ns), 3, 70))
    kernel_counters = KernelCounters()
    found = [kernel_counters.since_last() for _ in range(3)]
    kernel_counters.close()
    assert found == [Counts(0, 0, 0), Counts(250, 0, 0), Counts(350, 0, 0)]
