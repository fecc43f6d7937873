"""Frames of a second vehicle, old frames, the curvature ahead, and commands that do not arrive."""

from collections.abc import Callable
from typing import Any

import can
import pytest
from made_frames import BEND
from scripted_vehicle import CRUISING, ENGAGED, STRAIGHT, Rig, mode_and_cause

from rt_controller.bus.messages import PREVIEW, REFERENCE, STATE, Node, StateSample
from rt_controller.bus.send import Outbox
from rt_controller.contract.faults import Fault, StopCause
from rt_controller.contract.signals import CurvaturePreview, Mode
from rt_controller.control.program import SolveStatus


def after_sending(rig: Rig, act: Callable[[], None]) -> None:
    rig.vehicle.after_sending = lambda now_ns: act()


def send_state(rig: Rig, outbox: Outbox, counter: int) -> None:
    sample = StateSample(CRUISING._replace(ey_m=-2.0), 0.0, 0, rig.vehicle.echo, False)
    outbox.send(STATE, sample, rig.clock.now_ns(), counter=counter)


@pytest.mark.parametrize("offset", [0, 1, 127])
def test_a_second_vehicle_ends_in_a_safe_stop_whatever_its_counter(rig, offset):
    rig.tick(10)
    other = Outbox(rig.vehicle_bus, Node.VEHICLE)
    after_sending(rig, lambda: send_state(rig, other, rig.vehicle.counter + offset))
    modes = [rig.tick().mode for _ in range(4)]
    assert modes[-1] is Mode.SAFE_STOP
    assert mode_and_cause(rig.tick()) == (Mode.SAFE_STOP, StopCause.STATE_CONFLICT)
    assert rig.heartbeat.faults & Fault.SOURCE_CONFLICT


@pytest.mark.parametrize("age", [8, 112])
def test_one_old_state_among_new_ones_is_not_used_and_stops_nothing(rig, age):
    rig.tick(10)
    other = Outbox(rig.vehicle_bus, Node.VEHICLE)
    after_sending(rig, lambda: send_state(rig, other, rig.vehicle.counter - age))
    assert rig.tick().mode is Mode.HOLD_PLAN
    after_sending(rig, lambda: None)
    assert rig.tick().mode is Mode.HOLD_PLAN  # the counter jumps back to that of the vehicle
    assert rig.tick().mode is Mode.NOMINAL


@pytest.mark.parametrize("offset", [0, 1])
def test_a_foreign_path_is_not_driven(rig, offset):
    rig.tick(10)
    other = Outbox(rig.vehicle_bus, Node.VEHICLE)
    foreign = STRAIGHT._replace(c0_m=3.0)

    def send_every_fourth():
        counter = rig.vehicle.counter
        if counter % 4 == 0:
            other.send(REFERENCE, foreign, rig.clock.now_ns(), counter=counter + offset)

    after_sending(rig, send_every_fourth)
    for _ in range(20):
        result = rig.tick()
        assert result.mode is Mode.NOMINAL
        assert result.path.c0_m == pytest.approx(STRAIGHT.c0_m)


@pytest.mark.parametrize("lag", [4, 16])
def test_a_path_that_lags_behind_the_states_is_not_used(rig, lag):
    """Also by a multiple of 16: the frames tell 128 periods apart."""
    rig.tick(10)
    late = Outbox(rig.vehicle_bus, Node.VEHICLE)
    rig.vehicle.path = None
    after_sending(
        rig,
        lambda: late.send(
            REFERENCE, STRAIGHT, rig.clock.now_ns(), counter=rig.vehicle.counter - lag
        ),
    )
    assert mode_and_cause(rig.tick(8)) == (Mode.SAFE_STOP, StopCause.REFERENCE_LOST)


@pytest.mark.parametrize("lag", [5, 16])
def test_commands_that_arrive_late_from_the_first_frame_on_are_detected(rig, lag):
    rig.vehicle.mission = None
    rig.tick(70)
    rig.vehicle.mission = ENGAGED
    for _ in range(20):
        rig.vehicle.command_echo = (rig.vehicle.counter + 1 - lag) % 128
        assert rig.tick().mode is Mode.STANDBY
        assert rig.heartbeat.faults & Fault.COMMANDS_UNANSWERED


def test_commands_that_no_longer_arrive_stop_the_car(rig):
    rig.tick(10)
    rig.vehicle.command_echo = rig.vehicle.counter
    modes = [rig.tick().mode for _ in range(8)]
    assert modes[:3] == [Mode.NOMINAL] * 3
    assert modes[-1] is Mode.SAFE_STOP
    assert rig.step.last.cause is StopCause.COMMANDS_UNANSWERED


def test_damaged_frames_among_good_ones_end_in_a_safe_stop(rig):
    rig.tick(10)
    number = STATE.codecs[0].arbitration_id
    damaged = can.Message(arbitration_id=number, is_extended_id=False, data=bytes(8))
    after_sending(rig, lambda: rig.vehicle_bus.send(damaged))
    assert [rig.tick().mode for _ in range(3)] == [Mode.NOMINAL] * 3
    assert rig.tick(4).mode is Mode.SAFE_STOP


def previews_of(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> list[CurvaturePreview | None]:
    """A list that every plan adds its preview to."""
    seen: list[CurvaturePreview | None] = []
    plan = rig.mpc.plan

    def watched(*arguments: Any) -> SolveStatus:
        seen.append(arguments[4])
        return plan(*arguments)

    monkeypatch.setattr(rig.mpc, "plan", watched)
    return seen


def test_a_preview_is_used_for_three_periods_and_its_loss_stops_nothing(rig, monkeypatch):
    rig.tick(3)
    rig.vehicle.preview = BEND
    rig.tick()  # the first frames are not used yet
    seen = previews_of(rig, monkeypatch)
    rig.tick()
    rig.vehicle.preview = None
    assert rig.tick(5).mode is Mode.NOMINAL
    assert seen == [pytest.approx(BEND)] * 4 + [None] * 2
    assert rig.heartbeat.faults == 0


def test_a_preview_marked_invalid_is_no_fault(rig, monkeypatch):
    """A vehicle without a map may send its frames so."""
    rig.vehicle.after_sending = lambda now_ns: rig.vehicle.outbox.send(
        PREVIEW, BEND, now_ns, is_valid=False
    )
    seen = previews_of(rig, monkeypatch)
    assert rig.tick(3).mode is Mode.NOMINAL
    assert seen == [None] * 3
    assert rig.heartbeat.faults == 0


def test_a_preview_that_contradicts_the_state_is_not_used_and_is_reported(rig, monkeypatch):
    circle = CurvaturePreview(3.0, *[0.005] * 5)  # the state has the curvature 0
    rig.vehicle.preview = circle
    rig.tick()  # the first frames are not used yet
    seen = previews_of(rig, monkeypatch)
    for _ in range(3):
        result = rig.tick()
        assert result.mode is Mode.NOMINAL
        assert rig.heartbeat.faults == result.faults == Fault.PREVIEW_IMPLAUSIBLE
    rig.vehicle.preview = BEND
    assert rig.tick().faults == rig.heartbeat.faults == 0
    assert seen == [None] * 3 + [pytest.approx(BEND)]
    rig.vehicle.preview, rig.vehicle.state = circle, None
    rig.tick()
    assert rig.heartbeat.faults == Fault.STATE_STALE  # nothing to compare with
