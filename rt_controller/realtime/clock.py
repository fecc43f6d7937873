"""When the next tick is: an absolute clock that keeps its phase, and one that needs no time."""

import ctypes
import errno
import time
from collections.abc import Callable
from typing import NamedTuple, Protocol

_CLOCK_MONOTONIC = 1
_TIMER_ABSTIME = 1
_NS_PER_S = 1_000_000_000
WATCH_NS = 200_000
"""before a tick: waking up takes some of it, and what was in the caches stays there"""
OVERSLEPT_NS = 300_000
"""more than this, and what was to be done before the tick may no longer fit"""
LINGER_S = 0.0005
"""short against the phase that the loop is set to"""


class Tick(NamedTuple):
    """One tick of a clock."""

    scheduled_ns: int
    lateness_ns: int
    """how long after that the loop woke up"""
    skipped: int
    """whole periods that went by unused before this one"""


class Clock(Protocol):
    """What a loop needs of time."""

    def now_ns(self) -> int:
        """The present on this clock, monotonic."""
        ...

    def align(self, first_tick_ns: int) -> None:
        """Set the phase: the next tick is at `first_tick_ns`, or whole periods later."""
        ...

    def approach(self, lead_ns: int) -> bool:
        """Sleep until `lead_ns` before the next tick; False if it was or is later than that."""
        ...

    def wait(self) -> Tick:
        """The next tick, once it is due."""
        ...

    def linger(self) -> None:
        """Let a little time go by while nothing is scheduled yet."""
        ...


class RealtimeClock:
    """next += period on CLOCK_MONOTONIC; after a stall whole periods are skipped, in phase."""

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._next_ns = time.monotonic_ns() + period_ns

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def align(self, first_tick_ns: int) -> None:
        behind_ns = time.monotonic_ns() - first_tick_ns
        periods = max(0, -(-behind_ns // self._period_ns))
        self._next_ns = first_tick_ns + periods * self._period_ns

    def approach(self, lead_ns: int) -> bool:
        early_ns = self._next_ns - lead_ns
        if time.monotonic_ns() > early_ns:
            return False
        sleep_until(early_ns)
        return time.monotonic_ns() < early_ns + OVERSLEPT_NS

    def wait(self) -> Tick:
        skipped = max(0, (time.monotonic_ns() - self._next_ns) // self._period_ns)
        scheduled_ns = self._next_ns + skipped * self._period_ns
        wake_at(scheduled_ns)
        self._next_ns = scheduled_ns + self._period_ns
        return Tick(scheduled_ns, time.monotonic_ns() - scheduled_ns, skipped)

    def linger(self) -> None:
        time.sleep(LINGER_S)


class LockstepClock:
    """As fast as possible: time moves by one period a tick, and the peer acts before each.

    `peer(now_ns)` is everything else that happens in a period, so a run depends on nothing but
    its inputs: the same seed gives the same frames.
    """

    def __init__(self, period_ns: int, peer: Callable[[int], None]) -> None:
        self._period_ns = period_ns
        self._peer = peer
        self._now_ns = 0

    def now_ns(self) -> int:
        return self._now_ns

    def align(self, first_tick_ns: int) -> None:
        """Nothing: the peer has always just spoken when a tick is due."""

    def approach(self, lead_ns: int) -> bool:
        return True

    def wait(self) -> Tick:
        self._now_ns += self._period_ns
        self._peer(self._now_ns)
        return Tick(self._now_ns, 0, 0)

    def linger(self) -> None:
        self.wait()


class _Timespec(ctypes.Structure):
    _fields_ = (("tv_sec", ctypes.c_long), ("tv_nsec", ctypes.c_long))


_libc = ctypes.CDLL(None)


def sleep_until(deadline_ns: int) -> None:
    """Sleep until `deadline_ns` on CLOCK_MONOTONIC, without the drift of a relative sleep."""
    deadline = _Timespec(deadline_ns // _NS_PER_S, deadline_ns % _NS_PER_S)
    # A signal ends the sleep early; its Python handler has run by then, and the rest is slept.
    while (
        _libc.clock_nanosleep(_CLOCK_MONOTONIC, _TIMER_ABSTIME, ctypes.byref(deadline), None)
        == errno.EINTR
    ):
        pass


def wake_at(deadline_ns: int) -> None:
    """Sleep until shortly before `deadline_ns` on CLOCK_MONOTONIC, and watch the rest go by."""
    sleep_until(deadline_ns - WATCH_NS)
    while time.monotonic_ns() < deadline_ns:
        pass
