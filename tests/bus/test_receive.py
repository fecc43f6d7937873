"""Which frames become the newest content of a message, and that every other frame is counted."""

import errno
from math import nan
from unittest.mock import Mock

import can
import pytest
from made_frames import CONTROL, SAMPLE, can_frame, can_frames

from rt_controller.bus.condition import BusState
from rt_controller.bus.messages import (
    CATALOGUE,
    COMMAND,
    REFERENCE,
    STATE,
    Command,
    Message,
    Node,
)
from rt_controller.bus.receive import (
    BACKLOG_FRAMES,
    MAX_FRAMES_PER_DRAIN,
    Inbox,
    Received,
    ReceptionCounts,
)
from rt_controller.bus.transport import open_bus
from rt_controller.contract.signals import Mode, VehicleState
from rt_controller.contract.timing import PERIOD_NS

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


@pytest.mark.parametrize("late", range(3))
def test_frames_with_different_counters_make_no_state(late: int) -> None:
    older, newer = can_frames(STATE, SAMPLE, 5), can_frames(STATE, SAMPLE, 6)
    mixed = [older[index] if index == late else newer[index] for index in range(3)]
    assert controller_inbox(*mixed).newest(STATE) is None


def test_an_incomplete_newer_state_leaves_the_complete_older_one() -> None:
    newer = can_frames(STATE, SAMPLE, 6)
    inbox = controller_inbox(*can_frames(STATE, SAMPLE, 5), *newer[:2])
    assert newest_counter(inbox, STATE) == 5
    inbox.accept(newer[2], 1)
    assert newest_counter(inbox, STATE) == 6


@pytest.mark.parametrize("field", VehicleState._fields)
def test_a_nan_in_any_state_frame_makes_no_state(field: str) -> None:
    bad = SAMPLE._replace(state=SAMPLE.state._replace(**{field: nan}))
    inbox = controller_inbox(*can_frames(STATE, SAMPLE, 5), *can_frames(STATE, bad, 6))
    assert newest_counter(inbox, STATE) == 5
    assert inbox.counts.out_of_range == 1
    assert (inbox.out_of_range(STATE), inbox.out_of_range(REFERENCE)) == (1, 0)


def test_a_state_with_a_damaged_frame_is_skipped() -> None:
    a, b, c = can_frames(STATE, SAMPLE, 5)
    b.data[3] ^= 0x10
    inbox = controller_inbox(*can_frames(STATE, SAMPLE, 4), a, b, c)
    assert newest_counter(inbox, STATE) == 4
    assert inbox.counts.crc_errors == 1
    for frame in can_frames(STATE, SAMPLE, 6):
        inbox.accept(frame, 1)
    assert newest_counter(inbox, STATE) == 6
    assert inbox.counts.counter_gap_frames == 1


@pytest.mark.parametrize("message", CATALOGUE.messages)
def test_a_frame_without_values_is_counted_and_changes_nothing(message) -> None:
    inbox = Inbox(Node.VEHICLE if message.sender is Node.CONTROLLER else Node.CONTROLLER)
    for codec in message.codecs:
        inbox.accept(can_frame(codec, codec.encode([nan] * len(codec.signals), 0, 1)), 0)
    refused = [codec for codec in message.codecs if codec.required]
    assert inbox.counts == ReceptionCounts(out_of_range=len(refused))
    assert (inbox.newest(message) is None) == bool(refused), "only optional signals may all be NaN"


def test_frames_of_the_own_role_are_counted_as_foreign() -> None:
    assert controller_inbox(command(3)).foreign_frames == 1
    inbox = vehicle_inbox(*can_frames(STATE, SAMPLE, 5))
    assert inbox.foreign_frames == 3
    assert inbox.counts == NO_TROUBLE


@pytest.mark.parametrize(("bit", "length"), [(0, 8), (12, 8), (63, 8), (0, 7), (0, 1)])
def test_a_damaged_or_short_frame_is_dropped_and_does_not_move_the_counter(
    bit: int, length: int
) -> None:
    damaged = command(9)
    damaged.data[bit // 8] ^= 1 << bit % 8
    del damaged.data[length:]
    inbox = vehicle_inbox(command(3), damaged, command(4))
    assert newest_counter(inbox, COMMAND) == 4
    assert inbox.counts == ReceptionCounts(crc_errors=1)


def test_a_repeated_counter_is_dropped_and_the_old_arrival_stays() -> None:
    """So a stuck controller looks as silent as a dead one, and the vehicle brakes."""
    other = Command(CONTROL._replace(throttle=0.9), Mode.NOMINAL)
    inbox = vehicle_inbox(command(3), command(3), command(3, other))
    assert inbox.newest(COMMAND) == Received(NOMINAL, 3, 0)
    assert inbox.counts == ReceptionCounts(repeated=2, contradicting=1)


def test_frames_of_another_kind_or_id_are_ignored() -> None:
    extended, remote, other = command(0), command(0), command(0)
    extended.is_extended_id = True
    remote.is_remote_frame = True
    other.arbitration_id = 0x555
    inbox = vehicle_inbox(extended, remote, other)
    assert inbox.newest(COMMAND) is None
    assert inbox.counts == NO_TROUBLE


def test_error_frames_are_counted() -> None:
    error = command(0)
    error.is_error_frame = True
    inbox = vehicle_inbox(error)
    assert inbox.newest(COMMAND) is None
    assert inbox.counts == ReceptionCounts()
    assert inbox.condition.error_frames == 1


def test_draining_reads_all_waiting_frames_and_stamps_them_with_the_given_time() -> None:
    inbox = Inbox(Node.VEHICLE)
    with open_bus("virtual", "drain") as near, open_bus("virtual", "drain") as far:
        for counter in range(5):
            far.send(command(counter), timeout=0)
        assert inbox.drain(near, 777) == 5
        assert inbox.drain(near, 888) == 0
    assert inbox.newest(COMMAND) == Received(NOMINAL, 4, 777)


def test_a_flooded_bus_does_not_delay_the_step(monkeypatch: pytest.MonkeyPatch) -> None:
    inbox = Inbox(Node.VEHICLE)
    with open_bus("virtual", "flood") as bus:
        monkeypatch.setattr(bus, "recv", lambda timeout: command(0))
        assert inbox.drain(bus, 0) == MAX_FRAMES_PER_DRAIN
    fewest_bits_of_a_frame = 47
    assert MAX_FRAMES_PER_DRAIN * fewest_bits_of_a_frame * 1e9 / PERIOD_NS > 1.5e6


def test_an_interface_that_is_down_is_no_failure(monkeypatch: pytest.MonkeyPatch) -> None:
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
    assert inbox.condition.state is BusState.ACTIVE
    assert inbox.counts == NO_TROUBLE


def test_frames_that_the_socket_lost_are_counted_after_a_backlog(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("rt_controller.bus.receive.overflowed_frames", lambda bus: 7)
    inbox = Inbox(Node.VEHICLE)
    with open_bus("virtual", "lost") as near, open_bus("virtual", "lost") as far:
        for n_frames, lost in ((BACKLOG_FRAMES, 0), (BACKLOG_FRAMES + 1, 7)):
            for _ in range(n_frames):
                far.send(can.Message(arbitration_id=0x7FF, is_extended_id=False), timeout=0)
            inbox.drain(near, 0)
            assert inbox.counts.overflowed == lost


def test_a_bus_that_fails_is_counted_and_explained_but_raises_nothing() -> None:
    inbox = Inbox(Node.VEHICLE)
    bus = open_bus("virtual", "closed")
    bus.shutdown()
    assert inbox.last_failure == ""
    assert inbox.drain(bus, 0) == 0
    assert inbox.drain(bus, 1) == 0
    assert inbox.counts == ReceptionCounts(receive_failures=2)
    assert "closed" in inbox.last_failure
