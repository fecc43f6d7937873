"""Is what we were told still true? Judged on the monotonic clock, and by the vehicle's own stamps.

A state counts for the tick that first sees it and for no other, and only if it did not linger on
its way; paths and missions live longer.
"""

from rt_controller.contract.timing import PERIOD_NS

STATE_MAX_AGE_NS = 2 * PERIOD_NS
"""a state that took this much longer than the fastest ones is history"""
ROUND_TRIP_MAX_TICKS = 4
"""from a command to the state that shows its effect: as old as a command may get"""
REFERENCE_MAX_AGE_NS = 3 * PERIOD_NS
"""a path stays true for longer than a state: it lies still while the car moves along it"""
TIMING_SLACK_NS = PERIOD_NS // 2
"""ages are multiples of the period: limits lie between two of them"""

_DRIFT_ALLOWED = 1000e-6
"""two clocks may differ by this much, one of them being slewed; a delay that grows no faster
cannot be told from that"""
_FORGET_AFTER_NS = 1_000_000_000
"""after such a gap the sender may have started anew, with another origin of its stamps"""


def is_fresh(arrival_ns: int, now_ns: int, max_age_ns: int) -> bool:
    """Whether something that arrived at `arrival_ns` is young enough at `now_ns`."""
    return 0 <= now_ns - arrival_ns <= max_age_ns + TIMING_SLACK_NS


class TransportDelay:
    """How much longer than the fastest ones a stamped message was on its way.

    Sender and receiver share no clock, so only what is beyond the smallest difference between
    arrival and stamp can be seen. The stamp comes round after `wrap_ns`.
    """

    def __init__(self, wrap_ns: int) -> None:
        self._wrap_ns = wrap_ns
        self._fastest_ns: float | None = None
        self._last_arrival_ns = 0

    def forget(self) -> None:
        """Take the next message for as fast as any can be."""
        self._fastest_ns = None

    def measure(self, arrival_ns: int, stamp_ns: int) -> int:
        """The extra delay of a message stamped `stamp_ns` that arrived at `arrival_ns`."""
        difference_ns = (arrival_ns - stamp_ns) % self._wrap_ns
        if self._fastest_ns is None or arrival_ns - self._last_arrival_ns > _FORGET_AFTER_NS:
            self._fastest_ns = difference_ns
        else:
            self._fastest_ns += _DRIFT_ALLOWED * (arrival_ns - self._last_arrival_ns)
        self._last_arrival_ns = arrival_ns
        # The nearer way round: beyond half a turn a message was faster, not slower.
        extra_ns = (difference_ns - self._fastest_ns) % self._wrap_ns
        if extra_ns > self._wrap_ns / 2:
            self._fastest_ns = difference_ns
            return 0
        return int(extra_ns)
