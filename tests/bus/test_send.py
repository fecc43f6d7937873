"""What is sent: frames that the other side decodes, counters without gaps, no blocking."""

import pytest
from made_frames import CONTENTS, CONTROL, SAMPLE, decode_frames, encode_frames
from recorded_frames import RecordedFrames

from rt_controller.bus.messages import COMMAND, STATE, Command, Node
from rt_controller.bus.receive import Inbox, ReceptionCounts
from rt_controller.bus.send import DiscardBus, Outbox
from rt_controller.bus.transport import open_bus
from rt_controller.contract.signals import Mode


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


def test_a_full_queue_is_counted_and_appears_as_a_gap():
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


def test_a_content_is_found_under_the_counter_it_was_sent_with():
    outbox = Outbox(DiscardBus(), Node.CONTROLLER)
    assert outbox.contents_until(COMMAND, 15, 1) == []
    outbox.send(COMMAND, throttle(0.5), 0, counter=15)
    assert outbox.contents_until(COMMAND, 15, 3) == [throttle(0.5)]
    for counter in range(3, 3 + 140):
        outbox.send(COMMAND, throttle(0.005 * counter), 0, counter=counter)
    for counter in range(15, 15 + 128):
        assert outbox.contents_until(COMMAND, counter % 128, 1) == [throttle(0.005 * counter)]
