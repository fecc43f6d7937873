"""A late tick is blamed on what took most of it."""

import time

import pytest

from rt_controller.realtime.lateness import Cause, Sight, TickParts, Witness, explain

BEFORE = Sight(cpu_ns=5_000_000, waited_ns=1_000_000, major_faults=3, steal_ticks=70)
QUIET = TickParts(
    wake_us=50.0, step_us=400.0, qp_us=100.0, bus_us=80.0, prepared_late_us=0.0, overrun_us=0.0
)


def after(cpu_us: float = 400.0, waited_us: float = 0.0, faults: int = 0, steal: int = 0) -> Sight:
    return Sight(
        BEFORE.cpu_ns + round(1e3 * cpu_us),
        BEFORE.waited_ns + round(1e3 * waited_us),
        BEFORE.major_faults + faults,
        BEFORE.steal_ticks + steal,
    )


@pytest.mark.parametrize(
    ("seen", "parts", "cause"),
    [
        (after(), QUIET._replace(wake_us=9_000.0), Cause.HOST),
        (after(), QUIET._replace(step_us=9_000.0), Cause.HOST),
        (after(cpu_us=9_000.0, steal=1), QUIET._replace(step_us=9_000.0), Cause.HOST),
        (after(waited_us=8_500.0), QUIET._replace(wake_us=9_000.0), Cause.PREEMPTED),
        (after(waited_us=8_500.0), QUIET._replace(step_us=9_000.0), Cause.PREEMPTED),
        (after(), QUIET._replace(wake_us=9_000.0, prepared_late_us=8_900.0), Cause.PREPARING),
        (after(), QUIET._replace(wake_us=49_000.0, overrun_us=48_000.0), Cause.OVERRUN),
        (after(faults=1), QUIET._replace(step_us=9_000.0), Cause.PAGE_FAULT),
        (after(9_000.0), QUIET._replace(step_us=9_000.0, qp_us=8_000.0), Cause.SOLVER),
        (after(9_000.0), QUIET._replace(step_us=9_000.0, bus_us=8_000.0), Cause.BUS),
        (after(9_000.0), QUIET._replace(step_us=9_000.0), Cause.COMPUTING),
    ],
)
def test_the_largest_share_is_the_cause(seen: Sight, parts: TickParts, cause: Cause) -> None:
    assert explain(BEFORE, seen, parts) is cause


def test_what_was_computed_before_the_tick_does_not_count() -> None:
    """The plan is prepared before it, in the same thread and between the same two looks."""
    parts = QUIET._replace(wake_us=10.0, step_us=9_000.0, qp_us=8_900.0, bus_us=50.0)
    assert explain(BEFORE, after(cpu_us=30_000.0), parts) is Cause.SOLVER


def test_a_witness_sees_this_thread_computing() -> None:
    witness = Witness()
    try:
        before = witness.look()
        end_ns = time.thread_time_ns() + 20_000_000
        while time.thread_time_ns() < end_ns:
            pass
        seen = witness.look()
    finally:
        witness.close()
    assert seen.cpu_ns - before.cpu_ns >= 20_000_000
    assert all(now >= then for now, then in zip(seen, before, strict=True))
