"""A late tick is blamed on what took most of it."""

import pytest

from rt_controller.realtime.lateness import Cause, Sight, TickParts, Witness, explain

BEFORE = Sight(waited_ns=1_000_000, major_faults=3, steal_ticks=70)
QUIET = TickParts(
    wake_us=50.0,
    step_us=400.0,
    cpu_us=400.0,
    qp_us=100.0,
    bus_us=80.0,
    prepared_late_us=0.0,
    overrun_us=0.0,
)
BUSY = QUIET._replace(step_us=9_000.0, cpu_us=9_000.0)


def after(waited_us: float = 0.0, faults: int = 0, steal: int = 0) -> Sight:
    return Sight(
        BEFORE.waited_ns + round(1e3 * waited_us),
        BEFORE.major_faults + faults,
        BEFORE.steal_ticks + steal,
    )


@pytest.mark.parametrize(
    ("seen", "parts", "cause"),
    [
        (after(), QUIET._replace(wake_us=9_000.0), Cause.HOST),
        (after(), QUIET._replace(step_us=9_000.0), Cause.HOST),
        (after(steal=1), BUSY, Cause.HOST),
        (after(waited_us=8_500.0), QUIET._replace(wake_us=9_000.0), Cause.PREEMPTED),
        (after(waited_us=8_500.0), QUIET._replace(step_us=9_000.0), Cause.PREEMPTED),
        (after(), QUIET._replace(wake_us=9_000.0, prepared_late_us=8_900.0), Cause.PREPARING),
        (after(), QUIET._replace(wake_us=49_000.0, overrun_us=48_000.0), Cause.OVERRUN),
        (after(faults=1), QUIET._replace(step_us=9_000.0), Cause.PAGE_FAULT),
        (after(), BUSY._replace(qp_us=8_000.0), Cause.SOLVER),
        (after(), BUSY._replace(bus_us=8_000.0), Cause.BUS),
        (after(), BUSY, Cause.COMPUTING),
    ],
)
def test_the_largest_share_is_the_cause(seen: Sight, parts: TickParts, cause: Cause) -> None:
    assert explain(BEFORE, seen, parts) is cause


def test_what_a_witness_counts_only_grows() -> None:
    witness = Witness()
    try:
        before = witness.look()
        bytearray(1 << 20)
        seen = witness.look()
    finally:
        witness.close()
    assert before.steal_ticks >= 0
    assert all(now >= then for now, then in zip(seen, before, strict=True))
