"""What leaves: frames that the other side understands, counters that count, no blocking."""

import can
import pytest

from rt_controller.bus import frames
from rt_controller.bus.frames import Fault, Heartbeat, Mission, RoadSample
from rt_controller.bus.identity import dbc_hash
from rt_controller.bus.inbox import CommandInbox, Inbox
from rt_controller.bus.outbox import ControllerOutbox, VehicleOutbox
from rt_controller.bus.transport import open_bus
from rt_controller.contract.signals import ControlInput, Mode, PathReference, VehicleState

STATE = VehicleState(20.0, 0.5, -0.1, 0.5, 0.25, 0.01)
ROAD = RoadSample(0.001, 25_000_000, None, True)
PATH = PathReference(1.0, 0.02, 0.001, 2e-5, 22.0, 0.5)


class Sink:
    """Remembers what was recorded, by copy."""

    def __init__(self) -> None:
        self.frames: list[tuple[int, int, bytes]] = []

    def record(self, message: can.Message, timestamp_ns: int) -> None:
        self.frames.append((timestamp_ns, message.arbitration_id, bytes(message.data)))


def test_all_that_the_vehicle_sends_arrives_at_the_controller() -> None:
    inbox = Inbox()
    with open_bus("virtual", "to-controller") as near, open_bus("virtual", "to-controller") as far:
        outbox = VehicleOutbox(far)
        for tick in range(20):
            outbox.send_state(STATE._replace(vx_mps=20.0 + 0.1 * tick), ROAD, tick)
            outbox.send_feedback(ControlInput(0.25, 0.0, 0.0), tick)
            outbox.send_reference(PATH, tick)
            outbox.send_mission(Mission(True, False, 3, 200_000_000), tick)
            outbox.send_identity(None, tick)
            assert inbox.drain(near, tick) == 8
    assert sum(inbox.counts) == 0
    assert (outbox.sent, outbox.send_failures, outbox.last_failure) == (160, 0, "")
    assert inbox.state is not None
    assert inbox.state.state.vx_mps == pytest.approx(21.9)
    assert inbox.state.command_echo is None
    assert inbox.state.is_watchdog_braking
    assert inbox.state.counter == 19 % 16
    assert inbox.reference is not None
    assert inbox.reference.path == pytest.approx(PATH)
    assert inbox.mission is not None
    assert inbox.mission.mission_id == 3
    assert inbox.feedback is not None
    assert inbox.feedback.applied.throttle == pytest.approx(0.25)
    assert inbox.peer is not None
    assert (inbox.peer.dbc_hash, inbox.peer.model_hash) == (dbc_hash(), None)


def test_all_that_the_controller_sends_arrives_at_the_vehicle() -> None:
    inbox = CommandInbox()
    heartbeat = Heartbeat(Mode.NOMINAL, Fault.DEADLINE_MISSED, 700_000, 2_000_000, 12)
    with open_bus("virtual", "to-vehicle") as near, open_bus("virtual", "to-vehicle") as far:
        outbox = ControllerOutbox(near)
        for tick in range(20):
            outbox.send_command(ControlInput(0.01 * tick, 0.0, 0.0), Mode.NOMINAL, tick, tick)
            outbox.send_heartbeat(heartbeat, tick)
            outbox.send_identity(1234, tick)
            assert inbox.drain(far, tick) == 3
    assert sum(inbox.counts) == 0
    assert inbox.command is not None
    assert inbox.command.control.throttle == pytest.approx(0.19)
    assert inbox.command.counter == 19 % 16
    assert inbox.heartbeat is not None
    assert inbox.heartbeat.faults == Fault.DEADLINE_MISSED
    assert inbox.peer is not None
    assert (inbox.peer.dbc_hash, inbox.peer.model_hash) == (dbc_hash(), 1234)


def test_a_state_that_the_vehicle_disowns_never_becomes_a_snapshot() -> None:
    inbox = Inbox()
    with open_bus("virtual", "disowned") as near, open_bus("virtual", "disowned") as far:
        VehicleOutbox(far).send_state(STATE, ROAD, 0, is_valid=False)
        assert inbox.drain(near, 0) == 3
    assert inbox.state is None
    assert inbox.counts.out_of_range == 3


def test_frames_that_wait_on_the_bus_do_not_change_when_the_next_is_sent() -> None:
    """The messages are prepared once and used again, so the bus must have its own copy."""
    with open_bus("virtual", "aliasing") as near, open_bus("virtual", "aliasing") as far:
        outbox = ControllerOutbox(near)
        for counter, throttle in enumerate((0.1, 0.2, 0.3)):
            outbox.send_command(ControlInput(throttle, 0.0, 0.0), Mode.NOMINAL, counter, 0)
        waiting = [far.recv(0) for _ in range(3)]
    decoded = [frames.decode_command(each.data) for each in waiting if each is not None]
    throttles = [command.control.throttle for command in decoded if command is not None]
    assert throttles == pytest.approx([0.1, 0.2, 0.3])


def test_a_full_queue_is_counted_and_shows_as_a_gap() -> None:
    inbox = CommandInbox()
    with (
        open_bus("virtual", "full") as near,
        open_bus("virtual", "full", options={"rx_queue_size": 2}) as far,
    ):
        outbox = ControllerOutbox(near)
        for tick in range(5):
            outbox.send_command(ControlInput(0.1, 0.0, 0.0), Mode.NOMINAL, tick, tick)
        assert (outbox.sent, outbox.send_failures) == (2, 3)
        assert "Could not send" in outbox.last_failure
        inbox.drain(far, 0)
        outbox.send_command(ControlInput(0.1, 0.0, 0.0), Mode.NOMINAL, 5, 5)
        inbox.drain(far, 1)
    assert inbox.counts.lost == 3
    assert inbox.command is not None
    assert inbox.command.counter == 5


def test_a_closed_bus_is_counted_and_raises_nothing() -> None:
    bus = open_bus("virtual", "shut")
    outbox = VehicleOutbox(bus)
    bus.shutdown()
    outbox.send_state(STATE, ROAD, 0)
    assert (outbox.sent, outbox.send_failures) == (0, 3)


def test_what_was_sent_and_read_is_recorded() -> None:
    sent, read = Sink(), Sink()
    inbox = Inbox(recorder=read)
    with open_bus("virtual", "recorded") as near, open_bus("virtual", "recorded") as far:
        VehicleOutbox(far, recorder=sent).send_state(STATE, ROAD, 1)
        ControllerOutbox(far, recorder=sent).send_command(
            ControlInput(0.1, 0.0, 0.0), Mode.NOMINAL, 0, 2
        )
        inbox.drain(near, 3)
    assert [stamp for stamp, _, _ in sent.frames] == [1, 1, 1, 2]
    assert [stamp for stamp, _, _ in read.frames] == [3] * 4
    assert [frame[1:] for frame in sent.frames] == [frame[1:] for frame in read.frames]


def test_a_command_is_found_under_the_counter_it_was_sent_with() -> None:
    with open_bus("virtual", "echoes") as bus, open_bus("virtual", "echoes"):
        outbox = ControllerOutbox(bus)
        assert outbox.command_under(3) is None
        for counter in range(3, 3 + 20):
            outbox.send_command(ControlInput(0.01 * counter, 0.0, 0.0), Mode.NOMINAL, counter, 0)
    for counter in range(7, 7 + 16):
        found = outbox.command_under(counter % 16)
        assert found is not None
        assert found.throttle == pytest.approx(0.01 * counter)


def test_of_two_commands_under_one_counter_the_vehicle_means_the_first() -> None:
    inbox = CommandInbox()
    with open_bus("virtual", "twice") as near, open_bus("virtual", "twice") as far:
        outbox = ControllerOutbox(far)
        for counter, throttle in ((4, 0.1), (5, 0.2), (5, 0.3)):
            outbox.send_command(ControlInput(throttle, 0.0, 0.0), Mode.NOMINAL, counter, 0)
        inbox.drain(near, 0)
    assert inbox.command is not None
    assert inbox.command.control == pytest.approx((0.2, 0.0, 0.0))
    assert outbox.command_under(inbox.command.counter) == (0.2, 0.0, 0.0)
