"""Checks of the age of received data, by the monotonic clock and the stamps of the vehicle.

A state is valid only for the tick that receives it, and only if it was not delayed on its way;
paths and missions are valid for longer.
"""

from typing import NamedTuple

from rt_controller.contract.timing import COMMAND_TIMEOUT_TICKS, LONG_COUNTER_MODULUS, PERIOD_NS

STATE_MAX_AGE_NS = 2 * PERIOD_NS
"""oldest state that is planned from, counted beyond the fastest transport"""
ROUND_TRIP_MAX_TICKS = COMMAND_TIMEOUT_TICKS
"""most periods from a command to the state that shows its effect"""
REFERENCE_MAX_TICKS = 3
REFERENCE_MAX_AGE_NS = REFERENCE_MAX_TICKS * PERIOD_NS
"""oldest path that is planned with: it does not move while the car moves along it"""
TIMING_SLACK_NS = PERIOD_NS // 2
"""ages are multiples of the period, so each limit lies between two of them"""

_MAX_CLOCK_DRIFT = 1000e-6
"""relative difference of two clocks, one of them being slewed; a delay that grows no faster than
this cannot be distinguished from it"""
_RESTART_AFTER_NS = 1_000_000_000
"""after such a gap the sender may have restarted, with another origin of its stamps"""


def is_fresh(arrival_ns: int, now_ns: int, max_age_ns: int) -> bool:
    """True if data that arrived at `arrival_ns` is at most `max_age_ns` old at `now_ns`."""
    return 0 <= now_ns - arrival_ns <= max_age_ns + TIMING_SLACK_NS


class TransportDelay:
    """Estimate of how much longer than the fastest messages a stamped message was on its way.

    Sender and receiver share no clock, so only a delay beyond the smallest difference between
    arrival and stamp can be measured. The stamp wraps around after `wrap_ns`.

    Two messages in a row have to be faster before they count: a reader that is stopped between its
    clock and its bus reads a message that was sent after the arrival it notes.
    """

    def __init__(self, wrap_ns: int) -> None:
        self._wrap_ns = wrap_ns
        self._fastest_ns: float | None = None
        self._early_ns = 0.0
        """by how much the last message was faster than the fastest"""
        self._last_arrival_ns = 0

    def reset(self) -> None:
        """Take the next message as the fastest."""
        self._fastest_ns = None

    def measure(self, arrival_ns: int, stamp_ns: int) -> int:
        """The extra delay, in ns, of a message stamped `stamp_ns` that arrived at `arrival_ns`."""
        difference_ns = (arrival_ns - stamp_ns) % self._wrap_ns
        if self._fastest_ns is None or arrival_ns - self._last_arrival_ns > _RESTART_AFTER_NS:
            self._fastest_ns = difference_ns
        else:
            self._fastest_ns += _MAX_CLOCK_DRIFT * (arrival_ns - self._last_arrival_ns)
        self._last_arrival_ns = arrival_ns
        extra_ns = (difference_ns - self._fastest_ns) % self._wrap_ns
        if extra_ns > self._wrap_ns / 2:  # negative modulo the wrap: faster than the fastest
            early_ns = self._wrap_ns - extra_ns
            confirmed_ns = min(early_ns, self._early_ns)
            self._fastest_ns -= confirmed_ns
            self._early_ns = early_ns - confirmed_ns
            return 0
        self._early_ns = 0.0
        return int(extra_ns)


REGULAR_SAMPLES = 40
"""the regular time is the mean of so many, a second: it follows a clock that is faster or slower"""


class SampleTime(NamedTuple):
    """When a state was sampled, compared with one sample every period."""

    late_s: float = 0.0
    """behind the regular time, which is the mean of about a second"""
    longer_s: float | None = 0.0
    """than a period, since the sample before; None: that one was not received"""


ON_TIME = SampleTime()


class SampleGrid:
    """The regular time of the samples of a vehicle, by their stamps and their counters."""

    def __init__(self, wrap_ns: int) -> None:
        """The stamp wraps around after `wrap_ns`."""
        self._wrap_ns = wrap_ns
        self._stamp_ns = self._counter = self._samples = 0
        self._late_ns = 0.0
        """of the last sample"""

    def measure(self, stamp_ns: int, counter: int) -> SampleTime:
        """The time of a sample; ON_TIME too if it is a period or more away from the regular one."""
        periods = (counter - self._counter) % LONG_COUNTER_MODULUS
        longer_ns = stamp_ns - self._stamp_ns - periods * PERIOD_NS
        longer_ns = (longer_ns + self._wrap_ns // 2) % self._wrap_ns - self._wrap_ns // 2
        self._stamp_ns, self._counter = stamp_ns, counter
        self._late_ns += longer_ns
        if self._samples == 0 or abs(self._late_ns) >= PERIOD_NS:
            self._samples, self._late_ns = 1, 0.0
            return ON_TIME
        late_ns, self._samples = self._late_ns, min(self._samples + 1, REGULAR_SAMPLES)
        self._late_ns -= late_ns / self._samples
        if late_ns == longer_ns == 0.0:
            return ON_TIME
        return SampleTime(1e-9 * late_ns, 1e-9 * longer_ns if periods == 1 else None)
