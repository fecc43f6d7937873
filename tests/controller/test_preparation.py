"""What is done before a tick: frames are read; the dry run has no other effect."""

import gc
import sys

import can
import numpy as np
import pytest
from scripted_vehicle import CRUISING, ENGAGED, STANDBY_TICKS, Rig, build_rig

from rt_controller.bus.messages import STATE
from rt_controller.config import MpcSettings
from rt_controller.contract.faults import Fault
from rt_controller.contract.signals import Mode
from rt_controller.control.mpc import Mpc
from rt_controller.loop import Schedule, prepare_tick
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.realtime import timing
from rt_controller.realtime.timing import DeadlineAccount, TickTimer
from rt_controller.receive import READ_AHEAD_FRAMES
from rt_controller.safety.freshness import STATE_MAX_AGE_NS
from rt_controller.safety.tick import Tick

MS = 1_000_000


class ScriptedClock:
    """Counts down to a tick; actions take the time they are given."""

    def __init__(self, left_ns: int) -> None:
        self.left_ns = left_ns

    def sleep_until_before_tick(self, lead_ns: int) -> bool:
        if self.left_ns < lead_ns:
            return False
        self.left_ns = lead_ns
        return True


class ScriptedStep:
    """Each part takes a given time, on the scripted clock."""

    def __init__(self, clock: ScriptedClock, update_ns: int, warm_up_ns: int) -> None:
        self.done: list[tuple[str, int]] = []
        self._clock = clock
        self._update_ns, self._warm_up_ns = update_ns, warm_up_ns

    def update_matrices(self) -> None:
        self._act("update_matrices", self._update_ns)

    def read_ahead(self) -> None:
        self._act("read_ahead", 0)

    def warm_up(self) -> None:
        self._act("warm_up", self._warm_up_ns)

    def _act(self, part: str, takes_ns: int) -> None:
        self.done.append((part, self._clock.left_ns))
        self._clock.left_ns -= takes_ns


SCHEDULE = Schedule(4 * MS, (2 * MS, MS))
UPDATE = ("update_matrices", 4 * MS)
FIRST_WARM_UP = [("read_ahead", 2 * MS), ("warm_up", 2 * MS)]
SECOND_WARM_UP = [("read_ahead", MS), ("warm_up", MS)]


@pytest.mark.parametrize(
    ("left_ns", "update_ns", "warm_up_ns", "expected"),
    [
        pytest.param(
            *(20 * MS, MS, MS // 2, [UPDATE, *FIRST_WARM_UP, *SECOND_WARM_UP]), id="all in time"
        ),
        pytest.param(20 * MS, 3 * MS, MS // 2, [UPDATE, *SECOND_WARM_UP], id="long update"),
        pytest.param(20 * MS, 5 * MS, MS // 2, [UPDATE], id="update ends after the tick"),
        pytest.param(20 * MS, MS, 3 * MS // 2, [UPDATE, *FIRST_WARM_UP], id="long warm-up"),
        pytest.param(
            *(3 * MS, MS, MS // 2, [*FIRST_WARM_UP, *SECOND_WARM_UP]), id="too late to update"
        ),
        pytest.param(MS // 2, MS, MS // 2, [], id="too late for all"),
    ],
)
def test_each_part_is_done_at_its_time_or_left_out(
    monkeypatch, left_ns, update_ns, warm_up_ns, expected
):
    clock = ScriptedClock(left_ns)
    monkeypatch.setattr(timing.time, "perf_counter_ns", lambda: -clock.left_ns)
    step = ScriptedStep(clock, update_ns, warm_up_ns)
    timer = TickTimer(clock, DeadlineAccount(1, 0))
    prepare_tick(step, clock, SCHEDULE, timer)
    assert step.done == expected


AHEAD_NS = 1_500_000


def read_ahead_and_warm_up(rig: Rig) -> None:
    rig.step.read_ahead()
    rig.step.warm_up()


def prepared_tick(rig: Rig, warm_ups: int = 2) -> Tick:
    """One tick that was prepared `AHEAD_NS` before, when the vehicle had sent its frames."""
    rig.step.update_matrices()
    rig.clock.wait()
    for _ in range(warm_ups):
        read_ahead_and_warm_up(rig)
    rig.clock._now_ns += AHEAD_NS
    result = rig.step.run()
    rig.clock._now_ns -= AHEAD_NS
    rig.received.drain(rig.vehicle_bus, rig.clock.now_ns())
    return result


def test_frames_read_ahead_are_used_in_the_tick(rig):
    rig.tick(3)
    result = prepared_tick(rig)
    assert result.mode is Mode.NOMINAL
    assert result.state is not None
    newest = rig.inbox.newest(STATE)
    assert newest.content.state is result.state
    assert newest.counter == STANDBY_TICKS + 3  # that of the fourth state
    assert newest.arrival_ns == rig.clock.now_ns()  # not that of the tick
    assert result.qp_iterations > 0


def test_a_warm_up_sends_nothing_and_uses_no_counter(rig):
    rig.tick(3)
    counter, repeated = rig.command.counter, rig.received.counts.repeated
    rig.step.update_matrices()
    for _ in range(3):
        read_ahead_and_warm_up(rig)
    assert rig.vehicle_bus.recv(0.0) is None
    rig.tick()
    assert (rig.command.counter - counter) % 16 == 1
    assert rig.received.counts.counter_gap_frames == 0
    assert rig.received.counts.repeated == repeated


def test_the_plan_is_the_same_with_and_without_warm_ups(rig):
    plans = []
    for warm_ups in (0, 3):
        rig.vehicle.mission = ENGAGED._replace(is_engaged=False)
        rig.tick(60)  # the wheel is straight and the pedals are released again
        rig.vehicle.mission = ENGAGED
        for tick in range(5):
            rig.vehicle.state = CRUISING._replace(ey_m=0.2 - 0.01 * tick)
            prepared_tick(rig, warm_ups)
        plans.append(rig.mpc.inputs.copy())
    span = np.array([1.0, 15e3, 2 * np.pi])
    np.testing.assert_allclose(plans[0] / span, plans[1] / span, rtol=0.0, atol=1e-4)


def test_the_age_of_a_state_counts_from_when_it_was_read_ahead(rig):
    rig.tick(3)
    rig.clock.wait()
    read_ahead_and_warm_up(rig)
    rig.clock._now_ns += STATE_MAX_AGE_NS + 1_000_000  # the machine does not run for so long
    assert rig.step.run(skipped_ticks=1).mode is Mode.HOLD_PLAN
    rig.received.drain(rig.vehicle_bus, rig.clock.now_ns())
    assert Fault.STATE_STALE in rig.heartbeat.faults


def test_reading_ahead_ends_after_a_number_of_frames(rig):
    rig.tick(3)
    for _ in range(3 * READ_AHEAD_FRAMES):
        rig.vehicle_bus.send(can.Message(arbitration_id=0x7FF, is_extended_id=False, data=b"x"))
    rig.step.read_ahead()
    waiting = 0
    while rig.controller_bus.recv(0.0) is not None:
        waiting += 1
    assert waiting == 2 * READ_AHEAD_FRAMES


STEPS_PER_WINDOW = 150


@pytest.mark.nightly
def test_steps_keep_no_memory():
    """Memory that each step keeps grows in every window; caches fill, then a window keeps none.

    Caches of the interpreter and of numpy fill in about ten windows.
    """
    settings = MpcSettings()
    bundle = load_bundle(shipped_model())
    kept = []
    with build_rig(Mpc(bundle, settings.horizon, settings.cost())) as rig:
        while (not kept or kept[-1] >= STEPS_PER_WINDOW // 12) and len(kept) < 40:
            gc.collect()
            before = sys.getallocatedblocks()
            run_steps(rig, STEPS_PER_WINDOW)
            gc.collect()
            kept.append(sys.getallocatedblocks() - before)
        assert rig.step.last.mode is Mode.NOMINAL
    assert kept[-1] < STEPS_PER_WINDOW // 12, kept


def run_steps(rig: Rig, steps: int) -> None:
    for _ in range(steps):
        rig.tick()
        rig.step.update_matrices()
        rig.step.read_ahead()
        rig.step.warm_up()
