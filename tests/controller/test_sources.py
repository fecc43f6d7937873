"""Frames of a second vehicle, old frames and commands that do not arrive."""

from collections.abc import Callable, Iterator

import can
import pytest
from scripted_vehicle import CRUISING, ENGAGED, STRAIGHT, Rig, build_rig, mode_and_cause

from rt_controller.bus.messages import MISSION, REFERENCE, STATE, Node, StateSample
from rt_controller.bus.send import Outbox
from rt_controller.contract.faults import Fault, StopCause
from rt_controller.contract.signals import Mode
from rt_controller.control.mpc import Mpc


@pytest.fixture(params=[False, True], ids=["classic", "fd"])
def rig(mpc_of_session: Mpc, request: pytest.FixtureRequest) -> Iterator[Rig]:
    with build_rig(mpc_of_session, is_fd=request.param) as built:
        yield built


def after_sending(rig: Rig, act: Callable[[], None]) -> None:
    rig.vehicle.after_sending = lambda now_ns: act()


def send_state(rig: Rig, outbox: Outbox, counter: int) -> None:
    sample = StateSample(CRUISING._replace(ey_m=-2.0), 0.0, 0, rig.vehicle.echo, False)
    outbox.send(STATE, sample, rig.clock.now_ns(), counter=counter)


@pytest.mark.parametrize("offset", [0, 1, 16, 127])
def test_a_second_vehicle_ends_in_a_safe_stop_whatever_its_counter(rig: Rig, offset: int) -> None:
    rig.tick(10)
    other = Outbox(rig.vehicle_bus, Node.VEHICLE, is_fd=rig.inbox.is_fd)
    after_sending(rig, lambda: send_state(rig, other, rig.vehicle.counter + offset))
    modes = [rig.tick().mode for _ in range(4)]
    assert modes[-1] is Mode.SAFE_STOP
    assert mode_and_cause(rig.tick()) == (Mode.SAFE_STOP, StopCause.STATE_CONFLICT)
    assert rig.heartbeat.faults & Fault.SOURCE_CONFLICT


@pytest.mark.parametrize("age", [8, 112])
def test_one_old_state_among_new_ones_is_not_used_and_stops_nothing(rig: Rig, age: int) -> None:
    rig.tick(10)
    other = Outbox(rig.vehicle_bus, Node.VEHICLE, is_fd=rig.inbox.is_fd)
    after_sending(rig, lambda: send_state(rig, other, rig.vehicle.counter - age))
    assert rig.tick().mode is Mode.HOLD_PLAN
    after_sending(rig, lambda: None)
    assert rig.tick().mode is Mode.HOLD_PLAN  # the counter jumps back to that of the vehicle
    assert rig.tick().mode is Mode.NOMINAL


@pytest.mark.parametrize("offset", [0, 1, 100])
def test_a_foreign_path_is_not_driven(rig: Rig, offset: int) -> None:
    rig.tick(10)
    other = Outbox(rig.vehicle_bus, Node.VEHICLE, is_fd=rig.inbox.is_fd)
    foreign = STRAIGHT._replace(c0_m=3.0)

    def send_every_fourth() -> None:
        counter = rig.vehicle.counter
        if counter % 4 == 0:
            other.send(REFERENCE, foreign, rig.clock.now_ns(), counter=counter + offset)

    after_sending(rig, send_every_fourth)
    for _ in range(20):
        result = rig.tick()
        assert result.mode is Mode.NOMINAL
        assert result.path is not None
        assert result.path.c0_m == pytest.approx(STRAIGHT.c0_m)


@pytest.mark.parametrize("lag", [4, 16, 100])
def test_a_path_that_lags_behind_the_states_is_not_used(rig: Rig, lag: int) -> None:
    """Also by a multiple of 16: the frames tell 128 periods apart."""
    rig.tick(10)
    late = Outbox(rig.vehicle_bus, Node.VEHICLE, is_fd=rig.inbox.is_fd)
    rig.vehicle.path = None
    after_sending(
        rig,
        lambda: late.send(
            REFERENCE, STRAIGHT, rig.clock.now_ns(), counter=rig.vehicle.counter - lag
        ),
    )
    assert mode_and_cause(rig.tick(8)) == (Mode.SAFE_STOP, StopCause.REFERENCE_LOST)


def test_one_mission_without_engage_does_not_end_a_drive(rig: Rig) -> None:
    rig.tick(10)
    rig.vehicle.mission = ENGAGED._replace(is_engaged=False)
    assert rig.tick().mode is Mode.NOMINAL
    rig.vehicle.mission = ENGAGED
    assert rig.tick(10).mode is Mode.NOMINAL
    assert rig.inbox.newest(MISSION) is not None


@pytest.mark.parametrize("lag", [5, 16, 60])
def test_commands_that_arrive_late_from_the_first_frame_on_are_detected(rig: Rig, lag: int) -> None:
    rig.vehicle.mission = None
    rig.tick(70)
    rig.vehicle.mission = ENGAGED
    for _ in range(20):
        rig.vehicle.command_echo = (rig.vehicle.counter + 1 - lag) % 128
        assert rig.tick().mode is Mode.STANDBY
        assert rig.heartbeat.faults & Fault.COMMANDS_UNANSWERED


def test_commands_that_no_longer_arrive_stop_the_car(rig: Rig) -> None:
    rig.tick(10)
    rig.vehicle.command_echo = rig.vehicle.counter
    modes = [rig.tick().mode for _ in range(8)]
    assert modes[:3] == [Mode.NOMINAL] * 3
    assert modes[-1] is Mode.SAFE_STOP
    assert rig.step.last.cause is StopCause.COMMANDS_UNANSWERED


def test_damaged_frames_among_good_ones_end_in_a_safe_stop(rig: Rig) -> None:
    rig.tick(10)
    number = STATE.codecs[0].arbitration_id
    damaged = can.Message(arbitration_id=number, is_extended_id=False, data=bytes(8))
    after_sending(rig, lambda: rig.vehicle_bus.send(damaged))
    assert [rig.tick().mode for _ in range(3)] == [Mode.NOMINAL] * 3
    assert rig.tick(4).mode is Mode.SAFE_STOP
