"""The cause of a late tick is what took most of its time."""

import pytest

from rt_controller.realtime.kernel_counters import Counts, KernelCounters, LateCause, late_cause
from rt_controller.realtime.tick_times import TickTimes

BEFORE = Counts(waited_ns=1_000_000, major_faults=3, steal_ticks=70)
QUIET = TickTimes(*(0.0 for _ in TickTimes._fields))._replace(
    wake_us=50.0, step_us=400.0, cpu_us=400.0, qp_us=100.0, receive_us=50.0, send_us=30.0
)
BUSY = QUIET._replace(step_us=9_000.0, cpu_us=9_000.0)


def after(waited_us: float = 0.0, faults: int = 0, steal: int = 0) -> Counts:
    return Counts(
        BEFORE.waited_ns + round(1e3 * waited_us),
        BEFORE.major_faults + faults,
        BEFORE.steal_ticks + steal,
    )


@pytest.mark.parametrize(
    ("counts", "times", "cause"),
    [
        (after(), QUIET._replace(wake_us=9_000.0), LateCause.HOST),
        (after(), QUIET._replace(step_us=9_000.0), LateCause.HOST),
        (after(steal=1), BUSY, LateCause.HOST),
        (after(waited_us=8_500.0), QUIET._replace(wake_us=9_000.0), LateCause.PREEMPTED),
        (after(waited_us=8_500.0), QUIET._replace(step_us=9_000.0), LateCause.PREEMPTED),
        (
            after(),
            QUIET._replace(wake_us=9_000.0, preparation_late_us=8_900.0),
            LateCause.PREPARING,
        ),
        (after(), QUIET._replace(wake_us=49_000.0, overrun_us=48_000.0), LateCause.OVERRUN),
        (after(faults=1), QUIET._replace(step_us=9_000.0), LateCause.PAGE_FAULT),
        (after(), BUSY._replace(qp_us=8_000.0), LateCause.SOLVER),
        (after(), BUSY._replace(receive_us=8_000.0), LateCause.BUS),
        (after(), BUSY, LateCause.COMPUTING),
    ],
)
def test_the_largest_share_is_the_cause(counts: Counts, times: TickTimes, cause: LateCause) -> None:
    assert late_cause(BEFORE, counts, times) is cause


def test_kernel_counters_never_decrease() -> None:
    kernel_counters = KernelCounters()
    try:
        before = kernel_counters.read()
        bytearray(1 << 20)
        after = kernel_counters.read()
    finally:
        kernel_counters.close()
    assert before.steal_ticks >= 0
    assert all(new >= old for new, old in zip(after, before, strict=True))
