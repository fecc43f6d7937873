"""The clocks of the loop: absolute real time that keeps its phase, and simulated time."""

import ctypes
import errno
import time
from collections.abc import Callable
from typing import NamedTuple, Protocol

from rt_controller.contract.timing import PERIOD_NS

_CLOCK_MONOTONIC = 1
_TIMER_ABSTIME = 1
_NS_PER_S = 1_000_000_000
BUSY_WAIT_NS = 200_000
"""before a tick the thread does not sleep: waking up takes time, and the caches stay warm"""
MAX_OVERSLEEP_NS = 300_000
"""after a longer one, too little time may be left before the tick"""
POLL_INTERVAL_S = 0.0005
"""between two looks at the bus; short compared with the phase of the loop"""


class ScheduledTick(NamedTuple):
    """One tick of a clock."""

    scheduled_ns: int
    lateness_ns: int
    """from the scheduled instant until the loop was woken"""
    skipped: int
    """whole periods that were skipped before this tick"""


class RealtimeClock:
    """next += period on CLOCK_MONOTONIC; after a stall whole periods are skipped, in phase."""

    def __init__(self) -> None:
        self._next_ns = time.monotonic_ns() + PERIOD_NS

    def now_ns(self) -> int:
        """The time on this clock, monotonic."""
        return time.monotonic_ns()

    def align(self, first_tick_ns: int) -> None:
        """Set the phase: the next tick is at `first_tick_ns`, or whole periods later."""
        behind_ns = time.monotonic_ns() - first_tick_ns
        periods = max(0, -(-behind_ns // PERIOD_NS))
        self._next_ns = first_tick_ns + periods * PERIOD_NS

    def sleep_until_before_tick(self, lead_ns: int) -> bool:
        """Sleep until `lead_ns` before the next tick; False if it is later than that."""
        deadline_ns = self._next_ns - lead_ns
        if time.monotonic_ns() > deadline_ns:
            return False
        sleep_until(deadline_ns)
        return time.monotonic_ns() < deadline_ns + MAX_OVERSLEEP_NS

    def wait(self) -> ScheduledTick:
        """The next tick, at its instant."""
        skipped = max(0, (time.monotonic_ns() - self._next_ns) // PERIOD_NS)
        scheduled_ns = self._next_ns + skipped * PERIOD_NS
        busy_wait_until(scheduled_ns)
        self._next_ns = scheduled_ns + PERIOD_NS
        return ScheduledTick(scheduled_ns, time.monotonic_ns() - scheduled_ns, skipped)

    def poll(self) -> None:
        """Wait for a short time while no tick is scheduled yet."""
        time.sleep(POLL_INTERVAL_S)


class LockstepClock:
    """Simulated time, as fast as possible: one period a tick, and the peer acts before each.

    `peer(now_ns)` does all that happens in a period outside the loop. A run then depends on its
    inputs only: the same seed gives the same frames.
    """

    def __init__(self, peer: Callable[[int], None]) -> None:
        self._peer = peer
        self._now_ns = 0

    def now_ns(self) -> int:
        return self._now_ns

    def align(self, first_tick_ns: int) -> None:
        """No effect: the peer has always just sent its frames when a tick is due."""

    def sleep_until_before_tick(self, lead_ns: int) -> bool:
        return True

    def wait(self) -> ScheduledTick:
        self._now_ns += PERIOD_NS
        self._peer(self._now_ns)
        return ScheduledTick(self._now_ns, 0, 0)

    def poll(self) -> None:
        self.wait()


class TimeSource(Protocol):
    """What a step needs of a clock."""

    def now_ns(self) -> int:
        """The time on this clock, monotonic."""


Clock = RealtimeClock | LockstepClock
"""the clock of a loop with a fixed period"""


class _Timespec(ctypes.Structure):
    _fields_ = (("tv_sec", ctypes.c_long), ("tv_nsec", ctypes.c_long))


_libc = ctypes.CDLL(None)


def sleep_until(deadline_ns: int) -> None:
    """Sleep until `deadline_ns` on CLOCK_MONOTONIC, without the drift of a relative sleep."""
    deadline = _Timespec(deadline_ns // _NS_PER_S, deadline_ns % _NS_PER_S)
    # A signal interrupts the sleep. Its Python handler has run by then; sleep the rest.
    while (
        _libc.clock_nanosleep(_CLOCK_MONOTONIC, _TIMER_ABSTIME, ctypes.byref(deadline), None)
        == errno.EINTR
    ):
        pass


def busy_wait_until(deadline_ns: int) -> None:
    """Sleep until shortly before `deadline_ns` on CLOCK_MONOTONIC, and busy-wait the rest."""
    sleep_until(deadline_ns - BUSY_WAIT_NS)
    while time.monotonic_ns() < deadline_ns:
        pass
