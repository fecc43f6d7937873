"""What is done before a tick: waiting frames are read; the dry run has no other effect."""

import can
import numpy as np
import pytest
from scripted_vehicle import CRUISING, ENGAGED, STANDBY_TICKS, Rig

from rt_controller.bus.messages import STATE
from rt_controller.contract.faults import Fault
from rt_controller.contract.signals import Mode
from rt_controller.receive import READ_AHEAD_FRAMES
from rt_controller.safety.freshness import STATE_MAX_AGE_NS
from rt_controller.safety.tick import Tick

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


def safe_stop(rig: Rig) -> None:
    rig.tick(3)
    rig.vehicle.state = None
    assert rig.tick(3).mode is Mode.SAFE_STOP


def test_frames_read_ahead_are_used_in_the_tick(rig: Rig) -> None:
    rig.tick(3)
    result = prepared_tick(rig)
    assert result.mode is Mode.NOMINAL
    assert result.state is not None
    newest = rig.inbox.newest(STATE)
    assert newest is not None
    assert newest.content.state is result.state
    assert newest.counter == STANDBY_TICKS + 3  # that of the fourth state
    assert newest.arrival_ns == rig.clock.now_ns()  # not that of the tick
    assert result.qp_iterations > 0


def test_a_warm_up_sends_nothing_and_uses_no_counter(rig: Rig) -> None:
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


def test_the_plan_is_the_same_with_and_without_warm_ups(rig: Rig) -> None:
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


def test_a_reset_request_while_the_car_moved_has_no_later_effect(rig: Rig) -> None:
    safe_stop(rig)
    rig.vehicle.state = CRUISING
    rig.vehicle.mission = ENGAGED._replace(is_reset_requested=True)
    assert prepared_tick(rig).mode is Mode.SAFE_STOP
    rig.vehicle.state = CRUISING._replace(vx_mps=0.0, ds_m=0.0)
    rig.vehicle.mission = None  # the last one is still valid
    assert prepared_tick(rig).mode is Mode.SAFE_STOP


def test_the_age_of_a_state_counts_from_when_it_was_read_ahead(rig: Rig) -> None:
    rig.tick(3)
    rig.clock.wait()
    read_ahead_and_warm_up(rig)
    rig.clock._now_ns += STATE_MAX_AGE_NS + 1_000_000  # the machine does not run for so long
    assert rig.step.run(skipped_ticks=1).mode is Mode.HOLD_PLAN
    rig.received.drain(rig.vehicle_bus, rig.clock.now_ns())
    assert Fault.STATE_STALE in rig.heartbeat.faults


def test_reading_ahead_ends_after_a_number_of_frames(rig: Rig) -> None:
    rig.tick(3)
    for _ in range(3 * READ_AHEAD_FRAMES):
        rig.vehicle_bus.send(can.Message(arbitration_id=0x7FF, is_extended_id=False, data=b"x"))
    rig.step.read_ahead()
    waiting = 0
    while rig.controller_bus.recv(0.0) is not None:
        waiting += 1
    assert waiting == 2 * READ_AHEAD_FRAMES


@pytest.mark.parametrize(("missing", "mode"), [("state", Mode.HOLD_PLAN), ("path", Mode.NOMINAL)])
def test_a_warm_up_without_state_or_path_has_no_effect(rig: Rig, missing: str, mode: Mode) -> None:
    read_ahead_and_warm_up(rig)
    rig.tick(3)
    setattr(rig.vehicle, missing, None)
    assert prepared_tick(rig).mode is mode
    assert all(np.isfinite(rig.command.content.control))
