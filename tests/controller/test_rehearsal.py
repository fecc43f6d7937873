"""What is done before a tick: frames that came are read, and nothing else shows outside."""

import can
import numpy as np
import pytest
from scripted_vehicle import CRUISING, ENGAGED, Rig

from rt_controller.bus.frames import Fault
from rt_controller.contract.signals import Mode
from rt_controller.safety.freshness import STATE_MAX_AGE_NS
from rt_controller.step import AHEAD_FRAMES

AHEAD_NS = 1_500_000


def tick_with_rehearsals(rig: Rig, rehearsals: int = 2) -> None:
    """The vehicle speaks, the controller rehearses, and the tick comes a little later."""
    rig.step.prepare()
    rig.clock.wait()
    for _ in range(rehearsals):
        rig.step.rehearse()
    rig.clock._now_ns += AHEAD_NS
    rig.step.run()
    rig.clock._now_ns -= AHEAD_NS
    rig.heard.drain(rig.vehicle_bus, rig.clock.now_ns())


def test_frames_read_ahead_count_for_the_tick(rig: Rig) -> None:
    rig.tick(3)
    tick_with_rehearsals(rig)
    outcome = rig.step.outcome
    assert outcome.mode is Mode.NOMINAL
    assert outcome.state is not None
    assert outcome.state.counter == rig.vehicle.outbox.last_state_counter
    assert outcome.state.arrival_ns == rig.clock.now_ns()  # not that of the tick
    assert outcome.listen_ns > 0
    assert outcome.qp_iterations > 0
    rig.tick()
    assert outcome.listen_ns == 0  # nothing was read ahead of that one


def test_a_rehearsal_sends_nothing_and_uses_up_no_counter(rig: Rig) -> None:
    rig.tick(3)
    counter = rig.command.counter
    rig.step.prepare()
    for _ in range(3):
        rig.step.rehearse()
    assert rig.vehicle_bus.recv(0.0) is None
    rig.tick()
    assert (rig.command.counter - counter) % 16 == 1
    assert rig.heard.counts.lost == rig.heard.counts.repeated == 0


def test_rehearsed_or_not_the_plan_is_the_same(rig: Rig) -> None:
    plans = []
    for rehearsals in (0, 3):
        rig.vehicle.mission = ENGAGED._replace(is_engaged=False)
        rig.tick(60)  # the wheel is straight and the pedals are up again
        rig.vehicle.mission = ENGAGED
        for tick in range(5):
            rig.vehicle.state = CRUISING._replace(ey_m=0.2 - 0.01 * tick)
            tick_with_rehearsals(rig, rehearsals)
        plans.append(rig.mpc.inputs.copy())
    span = np.array([1.0, 15e3, 2 * np.pi])
    np.testing.assert_allclose(plans[0] / span, plans[1] / span, rtol=0.0, atol=1e-4)


def test_a_reset_that_was_read_ahead_is_a_request_and_no_memory(rig: Rig) -> None:
    rig.tick(3)
    rig.vehicle.state = None
    rig.tick(3)
    rig.vehicle.state = CRUISING._replace(vx_mps=0.0, ds_m=0.0)
    rig.vehicle.mission = ENGAGED._replace(is_reset_requested=True)
    tick_with_rehearsals(rig)
    assert rig.step.outcome.mode is Mode.STANDBY


def test_a_request_to_reset_that_came_while_the_car_moved_is_not_remembered(rig: Rig) -> None:
    rig.tick(3)
    rig.vehicle.state = None
    rig.tick(3)
    rig.vehicle.state = CRUISING
    rig.vehicle.mission = ENGAGED._replace(is_reset_requested=True)
    tick_with_rehearsals(rig)
    assert rig.step.outcome.mode is Mode.SAFE_STOP
    rig.vehicle.state = CRUISING._replace(vx_mps=0.0, ds_m=0.0)
    rig.vehicle.mission = None  # the old one is still valid
    tick_with_rehearsals(rig)
    assert rig.step.outcome.mode is Mode.SAFE_STOP


def test_a_state_that_was_read_ahead_grows_old_like_any_other(rig: Rig) -> None:
    """The machine stands still between a rehearsal and its tick."""
    rig.tick(3)
    rig.clock.wait()
    rig.step.rehearse()
    rig.clock._now_ns += STATE_MAX_AGE_NS + 1_000_000
    rig.step.run(skipped_ticks=1)
    rig.heard.drain(rig.vehicle_bus, rig.clock.now_ns())
    assert rig.step.outcome.mode is Mode.HOLD_PLAN
    assert rig.heard.heartbeat is not None
    assert Fault.STATE_STALE in rig.heard.heartbeat.faults


def test_a_flood_is_not_read_to_its_end_ahead_of_a_tick(rig: Rig) -> None:
    rig.tick(3)
    for _ in range(3 * AHEAD_FRAMES):
        rig.vehicle_bus.send(can.Message(arbitration_id=0x7FF, is_extended_id=False, data=b"x"))
    rig.step.rehearse()
    waiting = 0
    while rig.controller_bus.recv(0.0) is not None:
        waiting += 1
    assert waiting == 2 * AHEAD_FRAMES


@pytest.mark.parametrize(("silent", "mode"), [("state", Mode.HOLD_PLAN), ("path", Mode.NOMINAL)])
def test_with_something_missing_a_rehearsal_does_no_harm(rig: Rig, silent: str, mode: Mode) -> None:
    rig.step.rehearse()
    rig.tick(3)
    setattr(rig.vehicle, silent, None)
    tick_with_rehearsals(rig)
    assert rig.step.outcome.mode is mode
    assert all(np.isfinite(rig.command.control))
