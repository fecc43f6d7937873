"""Which command the vehicle follows, and why it refuses another."""

from dataclasses import dataclass, field

import pytest
from made_frames import can_frame, can_frames

from rt_controller.bus.catalogue import COMMAND, CONTROLLER_IDENTITY, HEARTBEAT, STATE
from rt_controller.bus.contents import (
    NO_REFUSAL,
    Command,
    Fault,
    Heartbeat,
    Identity,
    Refusal,
    StateSample,
)
from rt_controller.bus.identity import own_identity
from rt_controller.bus.inbox import Inbox
from rt_controller.bus.message import Node
from rt_controller.contract.signals import AT_REST, NEUTRAL_INPUT, ControlInput, Mode
from rt_controller.contract.timing import COMMAND_TIMEOUT_TICKS, PERIOD_NS
from rt_controller.gateway.vehicle_envelope import OwnMotion
from sim_bridge.command_check import FOREIGN_TICKS, CommandCheck

CRUISE = Command(ControlInput(0.2, 0.0, 0.0), Mode.NOMINAL)
MOVING = OwnMotion(20.0, 0.0, is_mission_on=True)


@dataclass(slots=True)
class Rig:
    """A check that has followed a few commands; `tick` sends one and judges it."""

    check: CommandCheck = field(default_factory=lambda: CommandCheck(is_fd=False))
    inbox: Inbox = field(default_factory=lambda: Inbox(Node.VEHICLE))
    counter: int = 120
    """of the newest state"""

    def send(self, command: Command, counter: int, mode: Mode | None = None) -> None:
        heartbeat = Heartbeat(mode or command.mode, Fault(0), counter % 128, 0, 0, 1)
        for message, content in ((COMMAND, command), (HEARTBEAT, heartbeat)):
            for frame in can_frames(message, content, counter):
                self.inbox.accept(frame, self.now_ns)

    @property
    def now_ns(self) -> int:
        return self.counter * PERIOD_NS

    def judge(self) -> Refusal:
        self.check.take(self.inbox, self.now_ns, self.counter % 128, MOVING)
        self.inbox.end_period(self.now_ns)
        self.counter += 1
        return self.check.refusals

    def tick(self, command: Command = CRUISE) -> Refusal:
        self.send(command, self.counter)
        return self.judge()


@pytest.fixture
def rig() -> Rig:
    rig = Rig()
    assert [rig.tick() for _ in range(5)] == [NO_REFUSAL] * 5
    assert rig.check.accepted is not None
    return rig


def followed(rig: Rig) -> int:
    """State counter of the newest command that is followed."""
    assert rig.check.accepted is not None
    return rig.check.accepted.counter


def test_the_first_command_is_not_used_yet() -> None:
    rig = Rig()
    assert rig.judge() == NO_REFUSAL
    rig.tick()
    assert rig.check.accepted is None
    rig.tick()
    assert followed(rig) == (rig.counter - 1) % 128


def test_commands_are_followed_while_the_long_counter_wraps(rig: Rig) -> None:
    for _ in range(20):
        assert rig.tick() == NO_REFUSAL
        assert followed(rig) == (rig.counter - 1) % 128
    assert dict(rig.check.named()) == {}


def test_a_refused_command_leaves_the_one_before(rig: Rig) -> None:
    before = followed(rig)
    both = Command(ControlInput(0.2, 50.0, 0.0), Mode.NOMINAL)
    assert rig.tick(both) == Refusal.PEDALS
    assert followed(rig) == before
    assert rig.tick() == NO_REFUSAL
    assert followed(rig) == (rig.counter - 1) % 128
    assert dict(rig.check.named()) == {"PEDALS": 1}


def test_the_wheel_may_move_on_while_commands_were_missing(rig: Rig) -> None:
    turned = Command(CRUISE.control._replace(steer_rad=0.16), Mode.NOMINAL)  # two periods
    assert rig.tick(turned) == Refusal.STEERING
    assert rig.tick(turned) == NO_REFUSAL


def test_the_wheel_may_move_on_while_the_vehicle_was_held_up(rig: Rig) -> None:
    rig.counter += 1
    turned = Command(CRUISE.control._replace(steer_rad=0.16), Mode.NOMINAL)
    assert rig.tick(turned) == NO_REFUSAL


def test_the_wheel_may_move_on_since_the_last_command_that_was_followed(rig: Rig) -> None:
    rig.judge()  # without a command; the next one answers the state of this tick
    turned = Command(CRUISE.control._replace(steer_rad=0.16), Mode.NOMINAL)  # two periods
    rig.send(turned, rig.counter - 1)
    assert rig.judge() == NO_REFUSAL


@pytest.mark.parametrize("lag", range(8))
def test_a_command_that_answers_an_old_state_is_refused(rig: Rig, lag: int) -> None:
    for _ in range(lag):  # the counters of the commands stand still for so long
        rig.counter += 1
    rig.send(CRUISE, rig.counter - lag)
    assert rig.judge() == (Refusal.LATE if lag >= COMMAND_TIMEOUT_TICKS else NO_REFUSAL)


def test_a_command_without_a_heartbeat_is_refused(rig: Rig) -> None:
    (frame,) = can_frames(COMMAND, CRUISE, rig.counter)
    rig.inbox.accept(frame, rig.now_ns)
    assert rig.judge() == Refusal.HEARTBEAT


@pytest.mark.parametrize("silent", range(1, 12))
def test_a_heartbeat_that_was_silent_for_long_is_not_used(rig: Rig, silent: int) -> None:
    for _ in range(silent):
        (frame,) = can_frames(COMMAND, CRUISE, rig.counter)
        rig.inbox.accept(frame, rig.now_ns)
        assert rig.judge() == Refusal.HEARTBEAT
    assert rig.tick() == (Refusal.HEARTBEAT if silent >= 6 else NO_REFUSAL)


def test_a_heartbeat_of_another_mode_is_refused(rig: Rig) -> None:
    rig.send(CRUISE, rig.counter, mode=Mode.SAFE_STOP)
    assert rig.judge() == Refusal.HEARTBEAT


def test_a_heartbeat_of_another_state_is_refused(rig: Rig) -> None:
    (frame,) = can_frames(COMMAND, CRUISE, rig.counter)
    rig.inbox.accept(frame, rig.now_ns)
    contradicting = Heartbeat(CRUISE.mode, Fault(0), (rig.counter + 1) % 128, 0, 0, 1)
    (frame,) = can_frames(HEARTBEAT, contradicting, rig.counter)
    rig.inbox.accept(frame, rig.now_ns)
    assert rig.judge() == Refusal.HEARTBEAT


@pytest.mark.parametrize("offset", [0, 1, 3, 8, 15])
def test_a_second_controller_is_followed_by_none(rig: Rig, offset: int) -> None:
    other = Command(ControlInput(0.0, 10.0, 0.05), Mode.NOMINAL)
    refused = 0
    for _ in range(8):
        rig.send(CRUISE, rig.counter)
        rig.send(other, rig.counter + offset)
        refused += rig.judge() == Refusal.SOURCE
    assert refused >= 7


def test_a_controller_of_another_catalogue_is_followed_no_more(rig: Rig) -> None:
    found = []
    for k, identity in enumerate([own_identity(1), Identity(1, 1), Identity(1, 1)]):
        (frame,) = can_frames(CONTROLLER_IDENTITY, identity, k)
        rig.inbox.accept(frame, rig.now_ns)
        found.append(rig.tick())
    assert found == [NO_REFUSAL, NO_REFUSAL, Refusal.SOURCE]


def test_frames_of_another_vehicle_count_after_some_ticks_in_a_row(rig: Rig) -> None:
    sample = StateSample(AT_REST, 0.0, 0, None, False)
    found = []
    for k in range(FOREIGN_TICKS + 2):
        for frame in can_frames(STATE, sample, k):
            rig.inbox.accept(frame, rig.now_ns)
        found.append(rig.tick())
    assert found == [NO_REFUSAL] * (FOREIGN_TICKS - 1) + [Refusal.SOURCE] * 3
    assert rig.tick() == NO_REFUSAL


def test_damaged_frames_leave_the_last_command(rig: Rig) -> None:
    before = followed(rig)
    for _ in range(6):
        rig.inbox.accept(can_frame(COMMAND.codecs[0], bytes(8)), rig.now_ns)
        rig.judge()
    assert followed(rig) == before


def test_the_first_command_followed_may_turn_the_wheel_by_one_time_out() -> None:
    rig = Rig()
    standing = Command(NEUTRAL_INPUT._replace(steer_rad=0.3), Mode.STANDSTILL)
    rig.tick(standing)
    rig.counter += 2
    assert rig.tick(standing) == Refusal.STEERING
    assert [rig.tick(standing) for _ in range(3)][-1] == NO_REFUSAL


def test_the_wheel_may_move_for_the_periods_since_the_start_before_the_first_command() -> None:
    rig = Rig()
    turned = Command(NEUTRAL_INPUT._replace(steer_rad=0.25), Mode.STANDSTILL)  # three periods
    rig.tick(turned)
    assert rig.tick(turned) == Refusal.STEERING
    assert rig.tick(turned) == NO_REFUSAL


@pytest.mark.parametrize("ticks_before", [0, 1])
@pytest.mark.parametrize("frames", [1, None])
def test_another_vehicle_counts_from_its_first_tick_on(
    ticks_before: int, frames: int | None
) -> None:
    rig = Rig()
    found = [rig.judge() for _ in range(ticks_before)]
    for k in range(5):
        for frame in can_frames(STATE, StateSample(AT_REST, 0.0, 0, None, False), k)[:frames]:
            rig.inbox.accept(frame, rig.now_ns)
        found.append(rig.judge())
    assert found == [NO_REFUSAL] * (3 + ticks_before) + [Refusal.SOURCE] * 2
