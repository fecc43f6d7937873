"""The clock keeps its phase and counts skipped periods; a skipped tick is never made up later."""

import itertools
import time

import pytest

from rt_controller.contract.timing import PERIOD_NS
from rt_controller.realtime import clock as clock_module
from rt_controller.realtime.clock import (
    MAX_OVERSLEEP_NS,
    LockstepClock,
    RealtimeClock,
    busy_wait_until,
    sleep_until,
)


class ScriptedTime:
    """A monotonic clock that moves only in sleeps and stalls."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_ns = 1_000_000_000
        self.oversleep_ns = 0
        monkeypatch.setattr(clock_module.time, "monotonic_ns", lambda: self.now_ns)
        monkeypatch.setattr(clock_module, "sleep_until", self.sleep_until)
        monkeypatch.setattr(clock_module, "busy_wait_until", self.sleep_until)

    def sleep_until(self, deadline_ns: int) -> None:
        self.now_ns = max(self.now_ns, deadline_ns + self.oversleep_ns)


def test_ticks_are_one_period_apart_for_any_work_within_it(monkeypatch):
    scripted = ScriptedTime(monkeypatch)
    clock = RealtimeClock()
    ticks = []
    for work_ns in (0, 3_000_000, 24_999_999, 10):
        ticks.append(clock.wait())
        scripted.now_ns += work_ns
    scheduled = [tick.scheduled_ns for tick in ticks]
    assert [b - a for a, b in itertools.pairwise(scheduled)] == [PERIOD_NS] * 3
    assert all(tick.skipped == 0 and tick.lateness_ns == 0 for tick in ticks)


def test_after_a_stall_whole_periods_are_skipped_and_the_phase_is_kept(monkeypatch):
    scripted = ScriptedTime(monkeypatch)
    clock = RealtimeClock()
    first = clock.wait()
    scripted.now_ns += 4 * PERIOD_NS + 1_000_000
    after = clock.wait()
    assert (after.skipped, after.lateness_ns) == (3, 1_000_000)
    assert (after.scheduled_ns - first.scheduled_ns) % PERIOD_NS == 0
    following = clock.wait()
    assert following.scheduled_ns == after.scheduled_ns + PERIOD_NS
    assert following.skipped == 0


def test_aligning_sets_the_phase_and_never_the_past(monkeypatch):
    scripted = ScriptedTime(monkeypatch)
    clock = RealtimeClock()
    wanted_ns = scripted.now_ns - 3 * PERIOD_NS + 7
    clock.align(wanted_ns)
    tick = clock.wait()
    assert tick.scheduled_ns >= scripted.now_ns - PERIOD_NS
    assert (tick.scheduled_ns - wanted_ns) % PERIOD_NS == 0
    assert tick.skipped == 0


@pytest.mark.parametrize(("oversleep_ns", "is_in_time"), [(0, True), (MAX_OVERSLEEP_NS, False)])
def test_a_sleep_before_a_tick_reports_whether_it_ended_in_time(
    monkeypatch, oversleep_ns, is_in_time
):
    scripted = ScriptedTime(monkeypatch)
    clock = RealtimeClock()
    lead_ns = 4_000_000
    wake_up_ns = scripted.now_ns + PERIOD_NS - lead_ns
    scripted.oversleep_ns = oversleep_ns
    assert clock.sleep_until_before_tick(lead_ns) is is_in_time
    assert scripted.now_ns == wake_up_ns + oversleep_ns
    scripted.now_ns += 1
    assert not clock.sleep_until_before_tick(lead_ns)  # that instant is over
    scripted.oversleep_ns = 0
    assert clock.wait().scheduled_ns == wake_up_ns + lead_ns


@pytest.mark.parametrize("sleep", [sleep_until, busy_wait_until])
@pytest.mark.parametrize("ahead_ns", [2_000_000, -5_000_000])
def test_a_sleep_never_ends_early(sleep, ahead_ns):
    deadline_ns = time.monotonic_ns() + ahead_ns
    sleep(deadline_ns)
    assert time.monotonic_ns() >= deadline_ns


def test_in_lockstep_the_peer_acts_before_every_tick():
    calls: list[int] = []
    clock = LockstepClock(calls.append)
    for n in range(1, 4):
        tick = clock.wait()
        assert tick.scheduled_ns == clock.now_ns() == n * PERIOD_NS
        assert calls[-1] == n * PERIOD_NS
    clock.poll()
    assert calls == [n * PERIOD_NS for n in range(1, 5)]
