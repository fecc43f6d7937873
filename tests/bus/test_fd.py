"""Contents over CAN FD: one frame each, with the sequence check of a counter of eight bits."""

from collections.abc import Iterator
from typing import Any

import can
import pytest
from made_frames import CONTENTS, CONTROL, SAMPLE

from rt_controller.bus.identity import dbc_hash
from rt_controller.bus.messages import COMMAND, STATE, Command, Message, Node
from rt_controller.bus.receive import Inbox, ReceptionCounts
from rt_controller.bus.send import Outbox
from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import PERIOD_NS


class Wire:
    """A bus that keeps copies of what is sent."""

    def __init__(self) -> None:
        self.frames: list[can.Message] = []

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self.frames.append(
            can.Message(
                arbitration_id=msg.arbitration_id,
                is_extended_id=False,
                is_fd=msg.is_fd,
                data=bytes(msg.data),
                check=True,
            )
        )


def sent(message: Message[Any], counters: range) -> Iterator[can.Message]:
    """The frames of a message of CAN FD with these counters."""
    wire = Wire()
    outbox = Outbox(wire, message.sender, is_fd=True)
    for counter in counters:
        outbox.send(message, CONTENTS[message], 0, counter=counter)
    return iter(wire.frames)


def peer_of(message: Message[Any]) -> Node:
    return Node.CONTROLLER if message.sender is Node.VEHICLE else Node.VEHICLE


@pytest.mark.parametrize("message", CONTENTS, ids=lambda message: message.fd_codecs[0].name)
def test_a_content_arrives_as_over_classic_can_also_when_the_counter_wraps(
    message: Message[Any],
) -> None:
    classic_wire = Wire()
    Outbox(classic_wire, message.sender).send(message, CONTENTS[message], 0, counter=259)
    classic = Inbox(peer_of(message))
    for frame in classic_wire.frames:
        classic.accept(frame, 0)
    inbox = Inbox(peer_of(message), is_fd=True)
    for tick, frame in enumerate(sent(message, range(250, 260))):
        assert frame.is_fd
        inbox.accept(frame, tick * PERIOD_NS)
    newest, expected = inbox.newest_valid(message, 20 * PERIOD_NS), classic.newest(message)
    assert newest is not None
    assert expected is not None
    assert newest.content == expected.content
    assert newest.counter == 259 % 256
    assert inbox.counts == ReceptionCounts()


@pytest.mark.parametrize("lost", [0, 5, 6, 254])
def test_a_counter_that_is_too_far_ahead_or_goes_back_is_refused(lost: int) -> None:
    first, *_, last = sent(STATE, range(10, 12 + lost))
    inbox = Inbox(Node.CONTROLLER, is_fd=True)
    inbox.accept(first, 0)
    inbox.accept(last, PERIOD_NS)
    newest = inbox.newest(STATE)
    assert newest is not None
    is_accepted = lost <= 5
    assert newest.counter == (11 + lost if is_accepted else 10)
    assert inbox.counts.wrong_sequence == (not is_accepted)
    assert inbox.has_conflict(STATE, PERIOD_NS) is not is_accepted


def test_one_counter_with_two_contents_is_a_conflict() -> None:
    inbox = Inbox(Node.CONTROLLER, is_fd=True)
    (frame,) = sent(STATE, range(1))
    inbox.accept(frame, 0)
    wire = Wire()
    other = SAMPLE._replace(curvature_per_m=0.002)
    Outbox(wire, Node.VEHICLE, is_fd=True).send(STATE, other, 0, counter=0)
    inbox.accept(wire.frames[0], 1)
    assert inbox.has_conflict(STATE, 1)
    assert inbox.newest_valid(STATE, 1) is None
    assert inbox.counts.contradicting == 1


@pytest.mark.parametrize("is_fd", [False, True])
def test_frames_of_the_other_format_are_counted_and_dropped(is_fd: bool) -> None:
    wire = Wire()
    Outbox(wire, Node.VEHICLE, is_fd=is_fd).send(STATE, SAMPLE, 0)
    inbox = Inbox(Node.CONTROLLER, is_fd=not is_fd)
    for frame in wire.frames:
        inbox.accept(frame, 0)
    assert inbox.newest(STATE) is None
    assert inbox.counts == ReceptionCounts(other_format=1)  # both have the identifier of STATE_A


def test_a_command_is_found_again_under_the_counter_that_the_vehicle_echoes() -> None:
    outbox = Outbox(Wire(), Node.CONTROLLER, is_fd=True)
    for counter in range(300):
        control = CONTROL._replace(throttle=counter / 300)
        outbox.send(COMMAND, Command(control, Mode.NOMINAL), 0, counter=counter)
    for counter in range(299, 299 - 128, -1):
        (found,) = outbox.contents_until(COMMAND, counter % 128, 1)
        assert found.control.throttle == counter / 300


def test_both_formats_have_a_catalogue_of_their_own() -> None:
    assert dbc_hash(is_fd=True) != dbc_hash()
