"""Ages of received data, and transport delays measured without a common clock."""

import pytest

from rt_controller.contract.timing import PERIOD_NS
from rt_controller.safety.freshness import TIMING_SLACK_NS, TransportDelay, is_fresh

WRAP_NS = 6_553_600_000


@pytest.mark.parametrize(
    ("age_ns", "fresh"),
    [
        (0, True),
        (100, True),
        (100 + TIMING_SLACK_NS, True),
        (101 + TIMING_SLACK_NS, False),
        (-1, False),
    ],
)
def test_data_is_fresh_up_to_its_maximum_age_and_not_before_its_arrival(
    age_ns: int, fresh: bool
) -> None:
    now_ns = 10**9
    assert is_fresh(now_ns - age_ns, now_ns, max_age_ns=100) is fresh


def stamp(sent_ns: int, clock_offset_ns: int = 123_456_789) -> int:
    """The sender's own clock, with the resolution and the range of the frame."""
    return (sent_ns + clock_offset_ns) % WRAP_NS // 100_000 * 100_000


def test_a_constant_delay_is_not_measured() -> None:
    delay = TransportDelay(WRAP_NS)
    for k in range(1000):  # the stamp wraps around several times
        sent_ns = k * PERIOD_NS
        assert delay.measure(sent_ns + 7_000_000, stamp(sent_ns)) < 300_000


def test_a_delay_beyond_the_fastest_message_is_measured_in_full() -> None:
    delay = TransportDelay(WRAP_NS)
    for k in range(100):
        delay.measure(k * PERIOD_NS + 2_000_000, stamp(k * PERIOD_NS))
    for k, late_ns in enumerate((40_000_000, 400_000_000, 1_000_000_000), start=100):
        extra_ns = delay.measure(k * PERIOD_NS + late_ns, stamp(k * PERIOD_NS))
        assert extra_ns == pytest.approx(late_ns - 2_000_000, abs=2_000_000)  # fades by 1 ms/s


def test_a_faster_message_becomes_the_fastest() -> None:
    delay = TransportDelay(WRAP_NS)
    delay.measure(30_000_000, stamp(0))
    assert delay.measure(PERIOD_NS + 1_000_000, stamp(PERIOD_NS)) == 0
    late_ns = delay.measure(2 * PERIOD_NS + 30_000_000, stamp(2 * PERIOD_NS))
    assert late_ns == pytest.approx(29_000_000, abs=300_000)


@pytest.mark.parametrize("drift", [-500e-6, -100e-6, 100e-6, 500e-6])
def test_clock_drift_is_not_measured_as_a_delay(drift: float) -> None:
    delay = TransportDelay(WRAP_NS)
    for k in range(40 * 600):  # ten minutes
        sent_ns = k * PERIOD_NS
        assert delay.measure(sent_ns + 2_000_000, stamp(round(sent_ns * (1 + drift)))) < 1_000_000


def test_after_a_gap_the_delay_is_measured_from_zero_again() -> None:
    delay = TransportDelay(WRAP_NS)
    for k in range(100):
        delay.measure(k * PERIOD_NS, stamp(k * PERIOD_NS))
    restart_ns = 100 * PERIOD_NS + 2_000_000_000
    extra_ns = delay.measure(restart_ns, stamp(restart_ns - 1_500_000_000))
    assert extra_ns == 0
