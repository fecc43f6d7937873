"""Which frames become the newest content of a message, and that every other frame is counted."""

import errno
from itertools import permutations
from unittest.mock import Mock

import can
import pytest
from made_frames import (
    CONTENTS,
    CONTROL,
    PATH,
    SAMPLE,
    RecordedFrames,
    can_frames,
    decode_frames,
    encode_frames,
)

from rt_controller.bus.condition import BusCondition, BusState
from rt_controller.bus.messages import COMMAND, REFERENCE, STATE, Command, Message, Node
from rt_controller.bus.receive import (
    BACKLOG_FRAMES,
    MAX_FRAMES_PER_DRAIN,
    MAX_SPREAD_NS,
    Inbox,
    Received,
    ReceptionCounts,
)
from rt_controller.bus.send import Outbox
from rt_controller.bus.transport import open_bus
from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import COUNTER_MODULUS, PERIOD_NS


def throttle(value: float) -> Command:
    return Command(CONTROL._replace(throttle=value), Mode.NOMINAL)


@pytest.mark.parametrize(
    ("sender", "receiver"), [(Node.VEHICLE, Node.CONTROLLER), (Node.CONTROLLER, Node.VEHICLE)]
)
def test_all_that_one_end_sends_arrives_at_the_other(sender, receiver):
    contents = {message: each for message, each in CONTENTS.items() if message.sender is sender}
    inbox = Inbox(receiver)
    n_frames = sum(len(message.codecs) for message in contents)
    with open_bus("virtual", "both-ends") as near, open_bus("virtual", "both-ends") as far:
        outbox = Outbox(far, sender)
        for tick in range(20):
            for message, content in contents.items():
                outbox.send(message, content, tick)
            assert inbox.drain(near, tick) == n_frames
    assert inbox.counts == ReceptionCounts()
    assert (outbox.sent, outbox.send_failures, outbox.last_failure) == (20 * n_frames, 0, "")
    for message, content in contents.items():
        newest = inbox.newest(message)
        assert encode_frames(message, newest.content, 0) == encode_frames(message, content, 0)
        assert (newest.counter, newest.arrival_ns) == (19 % message.codecs[0].counter_modulus, 19)


def test_frames_that_wait_on_the_bus_do_not_change_when_the_next_is_sent():
    """The frames are prepared once and used again, so the bus must have its own copy."""
    with open_bus("virtual", "aliasing") as near, open_bus("virtual", "aliasing") as far:
        outbox = Outbox(near, Node.CONTROLLER)
        for value in (0.1, 0.2, 0.3):
            outbox.send(COMMAND, throttle(value), 0)
        waiting = [far.recv(0) for _ in range(3)]
    decoded = [decode_frames(COMMAND, each.data) for each in waiting if each is not None]
    assert [each.control.throttle for each in decoded if each is not None] == pytest.approx(
        [0.1, 0.2, 0.3]
    )


def test_a_full_queue_is_counted_and_is_a_gap_for_the_receiver():
    inbox = Inbox(Node.VEHICLE)
    with (
        open_bus("virtual", "full") as near,
        open_bus("virtual", "full", options={"rx_queue_size": 2}) as far,
    ):
        outbox = Outbox(near, Node.CONTROLLER)
        for tick in range(5):
            outbox.send(COMMAND, throttle(0.1), tick)
        assert (outbox.sent, outbox.send_failures) == (2, 3)
        assert "Could not send" in outbox.last_failure
        inbox.drain(far, 0)
        outbox.send(COMMAND, throttle(0.1), 5)
        inbox.drain(far, 1)
    assert inbox.counts.counter_gap_frames == 3
    newest = inbox.newest(COMMAND)
    assert newest.counter == 5


def test_sent_and_received_frames_are_recorded():
    sent, read = RecordedFrames(), RecordedFrames()
    inbox = Inbox(Node.CONTROLLER, read)
    with open_bus("virtual", "recorded") as near, open_bus("virtual", "recorded") as far:
        Outbox(far, Node.VEHICLE, sent).send(STATE, SAMPLE, 1)
        Outbox(far, Node.CONTROLLER, sent).send(COMMAND, throttle(0.1), 2)
        inbox.drain(near, 3)
    assert [stamp for stamp, _, _ in sent.frames] == [1, 1, 1, 2]
    assert [stamp for stamp, _, _ in read.frames] == [3] * 4
    assert [frame[1:] for frame in sent.frames] == [frame[1:] for frame in read.frames]


NOMINAL = Command(CONTROL, Mode.NOMINAL)
NO_TROUBLE = ReceptionCounts()


def controller_inbox(*frames: can.Message, arrival_ns: int = 0) -> Inbox:
    inbox = Inbox(Node.CONTROLLER)
    for frame in frames:
        inbox.accept(frame, arrival_ns)
    return inbox


def command(counter: int, content: Command = NOMINAL) -> can.Message:
    (frame,) = can_frames(COMMAND, content, counter)
    return frame


def vehicle_inbox(*frames: can.Message) -> Inbox:
    """An inbox that has read these frames at 0, 1, 2 ... ns."""
    inbox = Inbox(Node.VEHICLE)
    for arrival_ns, frame in enumerate(frames):
        inbox.accept(frame, arrival_ns)
    return inbox


def newest_counter(inbox: Inbox, message: Message) -> int | None:
    newest = inbox.newest(message)
    return None if newest is None else newest.counter


@pytest.mark.parametrize(
    ("bits", "length", "is_fd"), [(1, 8, False), (1 << 12, 8, False), (0, 7, False), (0, 8, True)]
)
def test_a_damaged_or_short_frame_or_one_of_can_fd_is_dropped(bits, length, is_fd):
    """It does not move the counter."""
    damaged = command(4)
    word = int.from_bytes(damaged.data, "little") ^ bits
    damaged.data, damaged.is_fd = bytearray(word.to_bytes(8, "little")[:length]), is_fd
    inbox = vehicle_inbox(command(3), damaged, command(4))
    assert newest_counter(inbox, COMMAND) == 4
    assert inbox.counts == ReceptionCounts(crc_errors=1)


def test_a_repeated_counter_is_dropped_and_the_old_arrival_stays():
    """So a stuck controller looks as silent as a dead one, and the vehicle brakes."""
    other = Command(CONTROL._replace(throttle=0.9), Mode.NOMINAL)
    inbox = vehicle_inbox(command(3), command(3), command(3, other))
    assert inbox.newest(COMMAND) == Received(NOMINAL, 3, 0)
    assert inbox.counts == ReceptionCounts(repeated=2, contradicting=1)


def test_a_flooded_bus_does_not_delay_the_step(monkeypatch):
    inbox = Inbox(Node.VEHICLE)
    with open_bus("virtual", "flood") as bus:
        monkeypatch.setattr(bus, "recv", lambda timeout: command(0))
        assert inbox.drain(bus, 0) == MAX_FRAMES_PER_DRAIN
    fewest_bits_of_a_frame = 47
    assert MAX_FRAMES_PER_DRAIN * fewest_bits_of_a_frame * 1e9 / PERIOD_NS > 1.5e6


def test_an_interface_that_is_down_is_no_failure(monkeypatch):
    """SocketCAN reports it once, and then delivers frames again when the interface is up."""
    inbox = Inbox(Node.VEHICLE)
    down = can.CanOperationError("Error receiving: Network is down", errno.ENETDOWN)
    with open_bus("virtual", "down") as near, open_bus("virtual", "down") as far:
        with monkeypatch.context() as switched_off:
            switched_off.setattr(near, "recv", Mock(side_effect=down))
            assert inbox.drain(near, 0) == 0
        assert inbox.condition.state is BusState.DOWN
        inbox.require_readable()
        far.send(command(0), timeout=0)
        assert inbox.drain(near, 1) == 1
        assert inbox.condition == BusCondition(link_downs=1)
        assert inbox.counts == NO_TROUBLE
        for number in (errno.ENODEV, errno.EBADF):
            gone = Mock(side_effect=can.CanOperationError("gone", number))
            monkeypatch.setattr(near, "recv", gone)
            inbox.drain(near, 2)
    assert inbox.condition == BusCondition(link_downs=1)
    assert inbox.counts == ReceptionCounts(receive_failures=2)


def test_frames_that_the_socket_lost_are_counted_after_a_backlog(monkeypatch):
    monkeypatch.setattr("rt_controller.bus.receive.overflowed_frames", lambda bus: 7)
    inbox = Inbox(Node.VEHICLE)
    with open_bus("virtual", "lost") as near, open_bus("virtual", "lost") as far:
        for n_frames, lost in ((BACKLOG_FRAMES, 0), (BACKLOG_FRAMES + 1, 7)):
            for _ in range(n_frames):
                far.send(can.Message(arbitration_id=0x7FF, is_extended_id=False), timeout=0)
            inbox.drain(near, 0)
            assert inbox.counts.overflowed == lost


def test_a_bus_that_fails_is_counted_and_explained_but_raises_nothing():
    inbox = Inbox(Node.VEHICLE)
    bus = open_bus("virtual", "closed")
    bus.shutdown()
    assert inbox.last_failure == ""
    assert inbox.drain(bus, 0) == 0
    assert inbox.drain(bus, 1) == 0
    assert inbox.counts == ReceptionCounts(receive_failures=2)
    assert "closed" in inbox.last_failure


def test_frames_that_are_foreign_or_of_another_kind_are_ignored():
    """Those of the own role are counted, and error frames by the condition of the bus."""
    extended, remote, other, error = command(0), command(0), command(0), command(0)
    extended.is_extended_id = remote.is_remote_frame = error.is_error_frame = True
    other.arbitration_id = 0x555
    inbox = vehicle_inbox(extended, remote, other, error, *can_frames(STATE, SAMPLE, 5))
    assert inbox.newest(COMMAND) is None
    assert (inbox.counts, inbox.foreign_frames) == (NO_TROUBLE, 3)
    assert inbox.condition.error_frames == 1
    assert controller_inbox(command(3)).foreign_frames == 1


@pytest.mark.parametrize(
    ("message", "content", "order"),
    [(STATE, SAMPLE, order) for order in permutations(range(3))]
    + [(REFERENCE, PATH, order) for order in permutations(range(2))],
)
def test_frames_with_one_counter_make_a_content_in_any_order(message, content, order):
    inbox = Inbox(Node.CONTROLLER)
    frames = can_frames(message, content, 5)
    for position, index in enumerate(order):
        assert inbox.newest(message) is None
        inbox.accept(frames[index], 100 + position)
    newest = inbox.newest(message)
    assert encode_frames(message, newest.content, 5) == encode_frames(message, content, 5)
    assert (newest.counter, newest.arrival_ns) == (5, 100)


@pytest.mark.parametrize(
    ("spread_ns", "is_one_content"),
    [(MAX_SPREAD_NS, True), (MAX_SPREAD_NS + 1, False), (COUNTER_MODULUS * PERIOD_NS, False)],
)
def test_frames_of_different_cycles_of_the_counter_make_no_content(spread_ns, is_one_content):
    """A four-bit counter repeats every 16 periods: later it is another sample."""
    assert PERIOD_NS < MAX_SPREAD_NS < (COUNTER_MODULUS - 1) * PERIOD_NS
    for message, content in ((STATE, SAMPLE), (REFERENCE, PATH)):
        first, *others = can_frames(message, content, 5)
        inbox = controller_inbox(first)
        for frame in others:
            inbox.accept(frame, spread_ns)
        assert (inbox.newest(message) is not None) is is_one_content
