"""Ages of received data, and transport delays measured without a common clock."""

import pytest

from rt_controller.contract.timing import PERIOD_NS
from rt_controller.safety.freshness import (
    REFERENCE_MAX_AGE_NS,
    REFERENCE_MAX_TICKS,
    ROUND_TRIP_MAX_TICKS,
    STATE_MAX_AGE_NS,
    TIMING_SLACK_NS,
    TransportDelay,
    is_fresh,
)

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


@pytest.mark.parametrize(
    ("max_age_ns", "periods"), [(STATE_MAX_AGE_NS, 2), (REFERENCE_MAX_AGE_NS, 3)]
)
def test_states_and_paths_are_fresh_for_so_many_periods(max_age_ns: int, periods: int) -> None:
    for age, expected in ((periods + 0.49, True), (periods + 0.51, False)):
        assert is_fresh(0, round(age * 25_000_000), max_age_ns) is expected


def test_limits_in_ticks_are_those_of_the_documentation() -> None:
    assert (REFERENCE_MAX_TICKS, ROUND_TRIP_MAX_TICKS) == (3, 4)


def test_after_a_reset_the_next_message_is_the_fastest() -> None:
    delay = TransportDelay(WRAP_NS)
    assert delay.measure(10**9, 0) == 0
    delay.reset()
    assert delay.measure(10**9 + 30_000_000, 0) == 0


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


def test_two_faster_messages_in_a_row_become_the_fastest() -> None:
    delay = TransportDelay(WRAP_NS)
    delay.measure(30_000_000, stamp(0))
    assert delay.measure(PERIOD_NS + 1_000_000, stamp(PERIOD_NS)) == 0
    assert delay.measure(2 * PERIOD_NS + 3_000_000, stamp(2 * PERIOD_NS)) == 0
    late_ns = delay.measure(3 * PERIOD_NS + 30_000_000, stamp(3 * PERIOD_NS))
    assert late_ns == pytest.approx(27_000_000, abs=300_000)
    assert delay.measure(4 * PERIOD_NS + 1_000_000, stamp(4 * PERIOD_NS)) == 0


@pytest.mark.parametrize(
    ("on_the_way_ns", "extra_ns"),
    [
        ([1000, 900, 1500], 500),  # one faster message does not count
        ([1000, 1000, 900, 1500], 500),
        ([1000, 900, 1200, 900, 1500], 500),  # nor do two with another one between them
        ([1000, 900, 800, 1500], 600),  # of two it is the slower one
        ([1000, 800, 900, 1500], 600),
        ([1000, 900, 900, 850, 1500], 600),  # a third one that is still faster is a first one
        ([1000, 900, 800, 800, 1500], 700),
    ],
)
def test_a_delay_is_counted_from_the_fastest_messages_to_the_nanosecond(
    on_the_way_ns: list[int], extra_ns: int
) -> None:
    delay = TransportDelay(WRAP_NS)
    found_ns = [delay.measure(10**9, 10**9 - each_ns) for each_ns in on_the_way_ns]
    assert found_ns[-1] == extra_ns


def test_a_message_that_was_sent_after_its_noted_arrival_delays_no_later_one() -> None:
    """A process was frozen for 300 ms after it had read its clock, before it read the bus."""
    delay = TransportDelay(WRAP_NS)
    for k in range(100):
        arrival_ns = k * PERIOD_NS + (-290_000_000 if k == 50 else 2_000_000)
        assert delay.measure(arrival_ns, stamp(k * PERIOD_NS)) < 1_000_000


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


@pytest.mark.parametrize(("gap_ns", "expected_ns"), [(10**9, 39_000_000), (10**9 + 1, 0)])
def test_a_gap_is_longer_than_a_second(gap_ns: int, expected_ns: int) -> None:
    delay = TransportDelay(WRAP_NS)
    delay.measure(0, 0)
    late_ns = gap_ns - 40_000_000
    assert delay.measure(gap_ns, late_ns) == pytest.approx(expected_ns, abs=1)


@pytest.mark.parametrize(("share", "measured"), [(0.4, 0.4), (0.5, 0.5), (0.6, 0.0)])
def test_more_than_half_a_wrap_is_a_message_that_was_faster(share: float, measured: float) -> None:
    delay = TransportDelay(WRAP_NS)
    delay.measure(10**9, 0)
    assert delay.measure(10**9, -round(share * WRAP_NS)) == round(measured * WRAP_NS)
