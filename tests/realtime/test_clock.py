"""The clock keeps its phase, counts what it skips, and never catches up."""

import itertools
import time
from collections.abc import Callable

import pytest

from rt_controller.realtime import clock as clock_module
from rt_controller.realtime.clock import LockstepClock, RealtimeClock, sleep_until, wake_at

PERIOD_NS = 25_000_000


class ScriptedTime:
    """A monotonic clock that only moves when somebody sleeps or stalls."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_ns = 1_000_000_000
        monkeypatch.setattr(clock_module.time, "monotonic_ns", lambda: self.now_ns)
        monkeypatch.setattr(clock_module, "sleep_until", self.sleep_until)
        monkeypatch.setattr(clock_module, "wake_at", self.sleep_until)

    def sleep_until(self, deadline_ns: int) -> None:
        self.now_ns = max(self.now_ns, deadline_ns)


def test_ticks_are_whole_periods_apart_whatever_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    world = ScriptedTime(monkeypatch)
    clock = RealtimeClock(PERIOD_NS)
    ticks = []
    for work_ns in (0, 3_000_000, 24_999_999, 10):
        ticks.append(clock.wait())
        world.now_ns += work_ns
    scheduled = [tick.scheduled_ns for tick in ticks]
    assert [b - a for a, b in itertools.pairwise(scheduled)] == [PERIOD_NS] * 3
    assert all(tick.skipped == 0 and tick.lateness_ns == 0 for tick in ticks)


def test_a_late_tick_is_late_but_not_skipped(monkeypatch: pytest.MonkeyPatch) -> None:
    world = ScriptedTime(monkeypatch)
    clock = RealtimeClock(PERIOD_NS)
    first = clock.wait()
    world.now_ns += PERIOD_NS + 4_000_000
    second = clock.wait()
    assert second.scheduled_ns == first.scheduled_ns + PERIOD_NS
    assert second.lateness_ns == 4_000_000
    assert second.skipped == 0


def test_after_a_stall_whole_periods_are_skipped_and_the_phase_is_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = ScriptedTime(monkeypatch)
    clock = RealtimeClock(PERIOD_NS)
    first = clock.wait()
    world.now_ns += 4 * PERIOD_NS + 1_000_000
    after = clock.wait()
    assert after.skipped == 3
    assert (after.scheduled_ns - first.scheduled_ns) % PERIOD_NS == 0
    following = clock.wait()
    assert following.scheduled_ns == after.scheduled_ns + PERIOD_NS
    assert following.skipped == 0


def test_aligning_sets_the_phase_and_never_the_past(monkeypatch: pytest.MonkeyPatch) -> None:
    world = ScriptedTime(monkeypatch)
    clock = RealtimeClock(PERIOD_NS)
    wanted_ns = world.now_ns - 3 * PERIOD_NS + 7
    clock.align(wanted_ns)
    tick = clock.wait()
    assert tick.scheduled_ns >= world.now_ns - PERIOD_NS
    assert (tick.scheduled_ns - wanted_ns) % PERIOD_NS == 0
    assert tick.skipped == 0


@pytest.mark.parametrize("rest", [sleep_until, wake_at])
@pytest.mark.parametrize("ahead_ns", [2_000_000, 50_000, -5_000_000])
def test_nobody_wakes_early(rest: Callable[[int], None], ahead_ns: int) -> None:
    deadline_ns = time.monotonic_ns() + ahead_ns
    rest(deadline_ns)
    assert time.monotonic_ns() >= deadline_ns


def test_lockstep_lets_the_peer_act_before_every_tick() -> None:
    heard: list[int] = []
    clock = LockstepClock(PERIOD_NS, heard.append)
    for n in range(1, 4):
        tick = clock.wait()
        assert tick.scheduled_ns == clock.now_ns() == n * PERIOD_NS
        assert heard[-1] == n * PERIOD_NS
    clock.linger()
    assert heard == [n * PERIOD_NS for n in range(1, 5)]
