"""Old news, and news from the future, are no news."""

import pytest

from rt_controller.safety.freshness import TIMING_SLACK_NS, TransportDelay, is_fresh

WRAP_NS = 6_553_600_000
PERIOD_NS = 25_000_000


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
def test_freshness_ends_with_the_age_and_never_begins_in_the_future(
    age_ns: int, fresh: bool
) -> None:
    now_ns = 10**9
    assert is_fresh(now_ns - age_ns, now_ns, max_age_ns=100) is fresh


def stamp(sent_ns: int, clock_offset_ns: int = 123_456_789) -> int:
    """What the sender's own clock shows, as far as the frame carries it."""
    return (sent_ns + clock_offset_ns) % WRAP_NS // 100_000 * 100_000


def test_an_unchanging_delay_cannot_be_seen() -> None:
    delay = TransportDelay(WRAP_NS)
    for k in range(1000):  # the stamp comes round several times
        sent_ns = k * PERIOD_NS
        assert delay.measure(sent_ns + 7_000_000, stamp(sent_ns)) < 300_000


def test_a_delay_beyond_the_fastest_is_seen_in_full() -> None:
    delay = TransportDelay(WRAP_NS)
    for k in range(100):
        delay.measure(k * PERIOD_NS + 2_000_000, stamp(k * PERIOD_NS))
    for k, late_ns in enumerate((40_000_000, 400_000_000, 1_000_000_000), start=100):
        extra_ns = delay.measure(k * PERIOD_NS + late_ns, stamp(k * PERIOD_NS))
        assert extra_ns == pytest.approx(late_ns - 2_000_000, abs=2_000_000)  # fades by 1 ms/s


def test_a_faster_transport_becomes_the_measure() -> None:
    delay = TransportDelay(WRAP_NS)
    delay.measure(30_000_000, stamp(0))
    assert delay.measure(PERIOD_NS + 1_000_000, stamp(PERIOD_NS)) == 0
    late_ns = delay.measure(2 * PERIOD_NS + 30_000_000, stamp(2 * PERIOD_NS))
    assert late_ns == pytest.approx(29_000_000, abs=300_000)


@pytest.mark.parametrize("drift", [-500e-6, -100e-6, 100e-6, 500e-6])
def test_clocks_that_drift_apart_do_not_look_like_a_delay(drift: float) -> None:
    delay = TransportDelay(WRAP_NS)
    for k in range(40 * 600):  # ten minutes
        sent_ns = k * PERIOD_NS
        assert delay.measure(sent_ns + 2_000_000, stamp(round(sent_ns * (1 + drift)))) < 1_000_000


def test_after_a_gap_a_sender_with_another_origin_is_learnt_anew() -> None:
    delay = TransportDelay(WRAP_NS)
    for k in range(100):
        delay.measure(k * PERIOD_NS, stamp(k * PERIOD_NS))
    restart_ns = 100 * PERIOD_NS + 2_000_000_000
    extra_ns = delay.measure(restart_ns, stamp(restart_ns - 1_500_000_000))
    assert extra_ns == 0
