"""Both letter boxes: what becomes a snapshot, and what never does."""

from itertools import permutations
from math import nan

import can
import pytest

from rt_controller.bus import frames
from rt_controller.bus.codec import MessageCodec
from rt_controller.bus.frames import Fault, Heartbeat, Identity, Mission, RoadSample
from rt_controller.bus.inbox import MAX_SPREAD_NS, CommandInbox, Inbox
from rt_controller.bus.snapshot import (
    CommandSnapshot,
    FeedbackSnapshot,
    HeartbeatSnapshot,
    MissionSnapshot,
    PeerIdentity,
)
from rt_controller.bus.transport import open_bus
from rt_controller.contract.signals import ControlInput, Mode, PathReference, VehicleState
from rt_controller.contract.timing import PERIOD_NS

STATE = VehicleState(20.0, 0.5, -0.1, 0.5, 0.25, 0.01)
ROAD = RoadSample(0.001, 25_000_000, 6, False)
PATH = PathReference(1.0, 0.02, 0.001, 2e-5, 22.0, 0.5)
CONTROL = ControlInput(0.5, 0.0, 0.0)


def message(codec: MessageCodec, frame: bytes) -> can.Message:
    return can.Message(
        arbitration_id=codec.arbitration_id, is_extended_id=False, data=frame, check=True
    )


def state_messages(counter: int, state: VehicleState = STATE) -> tuple[can.Message, ...]:
    return (
        message(frames.STATE_A, frames.encode_state_a(state, counter)),
        message(frames.STATE_B, frames.encode_state_b(state, counter)),
        message(frames.STATE_C, frames.encode_state_c(ROAD, counter)),
    )


def reference_messages(counter: int, path: PathReference = PATH) -> tuple[can.Message, ...]:
    return (
        message(frames.REF_PATH, frames.encode_reference_path(path, counter)),
        message(frames.REF_SPEED, frames.encode_reference_speed(path, counter)),
    )


def filled(*messages: can.Message, arrival_ns: int = 0) -> Inbox:
    inbox = Inbox()
    for each in messages:
        inbox.accept(each, arrival_ns)
    return inbox


def snapshots(inbox: Inbox | CommandInbox) -> list[object]:
    counted = {"foreign_commands"}
    public = {name: value for name, value in vars(inbox).items() if not name.startswith("_")}
    return [value for name, value in public.items() if name not in counted]


def test_an_empty_box_holds_nothing() -> None:
    inbox, command_inbox = Inbox(), CommandInbox()
    assert snapshots(inbox) == [None] * 5
    assert snapshots(command_inbox) == [None] * 3
    assert sum(inbox.counts) == sum(command_inbox.counts) == inbox.foreign_commands == 0


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_three_frames_of_one_counter_make_a_state_in_any_order(order: tuple[int, ...]) -> None:
    inbox = Inbox()
    messages = state_messages(5)
    for position, index in enumerate(order):
        assert inbox.state is None
        inbox.accept(messages[index], 100 + position)
    assert inbox.state is not None
    assert inbox.state.state == pytest.approx(STATE)
    assert inbox.state.curvature_per_m == pytest.approx(0.001)
    assert inbox.state.sample_time_ns == 25_000_000
    assert inbox.state.command_echo == 6
    assert not inbox.state.is_watchdog_braking
    assert inbox.state.counter == 5
    assert inbox.state.arrival_ns == 100


@pytest.mark.parametrize("late", range(3))
def test_frames_of_different_counters_make_no_state(late: int) -> None:
    older, newer = state_messages(5), state_messages(6)
    mixed = [older[index] if index == late else newer[index] for index in range(3)]
    assert filled(*mixed).state is None


def test_an_incomplete_newer_state_leaves_the_complete_older_one() -> None:
    newer = state_messages(6, STATE._replace(vx_mps=10.0))
    inbox = filled(*state_messages(5), *newer[:2])
    assert inbox.state is not None
    assert inbox.state.counter == 5
    inbox.accept(newer[2], 1)
    assert inbox.state.counter == 6
    assert inbox.state.state.vx_mps == pytest.approx(10.0)


@pytest.mark.parametrize("field", VehicleState._fields)
def test_a_nan_in_any_state_frame_makes_no_state(field: str) -> None:
    inbox = filled(*state_messages(5))
    before = inbox.state
    for bad in state_messages(6, STATE._replace(**{field: nan})):
        inbox.accept(bad, 1)
    assert inbox.state is before
    assert inbox.counts.out_of_range == 1


def test_a_state_with_a_damaged_frame_is_skipped() -> None:
    a, b, c = state_messages(5)
    b.data[3] ^= 0x10
    inbox = filled(*state_messages(4), a, b, c)
    assert inbox.state is not None
    assert inbox.state.counter == 4
    assert inbox.counts.crc_errors == 1
    for each in state_messages(6):
        inbox.accept(each, 1)
    assert inbox.state.counter == 6
    assert inbox.counts.lost == 1


def test_frames_of_one_counter_from_different_rounds_make_no_state() -> None:
    """A four-bit counter comes round every 16 periods: 400 ms later it is another sample."""
    inbox = Inbox()
    a, _, _ = state_messages(5)
    _, b, c = state_messages(5)
    inbox.accept(a, 0)
    inbox.accept(b, 16 * PERIOD_NS)
    inbox.accept(c, 16 * PERIOD_NS)
    assert inbox.state is None


def test_the_spread_that_is_allowed_is_within_one_round_of_the_counter() -> None:
    assert PERIOD_NS < MAX_SPREAD_NS < 15 * PERIOD_NS
    inbox = Inbox()
    for each, arrival_ns in zip(state_messages(5), (0, 1, MAX_SPREAD_NS), strict=True):
        inbox.accept(each, arrival_ns)
    assert inbox.state is not None


@pytest.mark.parametrize("order", list(permutations(range(2))))
def test_two_frames_of_one_counter_make_a_reference(order: tuple[int, ...]) -> None:
    inbox = Inbox()
    messages = reference_messages(9)
    for position, index in enumerate(order):
        assert inbox.reference is None
        inbox.accept(messages[index], 50 + position)
    assert inbox.reference is not None
    assert inbox.reference.path == pytest.approx(PATH)
    assert (inbox.reference.counter, inbox.reference.arrival_ns) == (9, 50)


def test_half_references_of_different_counters_make_none() -> None:
    inbox = filled(reference_messages(8)[0], reference_messages(9)[1])
    assert inbox.reference is None


@pytest.mark.parametrize("field", PathReference._fields)
def test_a_nan_in_the_reference_makes_none(field: str) -> None:
    inbox = filled(*reference_messages(8, PATH._replace(**{field: nan})))
    assert inbox.reference is None
    assert inbox.counts.out_of_range == 1


def test_half_references_from_different_rounds_make_none() -> None:
    inbox = Inbox()
    path, speed = reference_messages(9)
    inbox.accept(path, 0)
    inbox.accept(speed, 16 * PERIOD_NS)
    assert inbox.reference is None


def test_mission_feedback_and_vehicle_arrive_at_the_controller() -> None:
    inbox = filled(
        message(
            frames.MISSION, frames.encode_mission(Mission(True, False, 4, 300_000_000), counter=2)
        ),
        message(frames.ACT_FB, frames.encode_feedback(CONTROL, counter=3)),
        message(
            frames.IDENT_VEHICLE, frames.encode_vehicle_identity(Identity(77, None), counter=1)
        ),
        arrival_ns=10,
    )
    assert inbox.mission == MissionSnapshot(True, False, 4, 300_000_000, counter=2, arrival_ns=10)
    assert inbox.feedback == FeedbackSnapshot(CONTROL, counter=3, arrival_ns=10)
    assert inbox.peer == PeerIdentity(77, None, counter=1, arrival_ns=10)


def test_command_heartbeat_and_controller_arrive_at_the_vehicle() -> None:
    inbox = CommandInbox()
    heartbeat = Heartbeat(Mode.HOLD_PLAN, Fault.SOLVER_FAILED, 500_000, 1_000_000, 30)
    for each in (
        message(frames.ACT_CMD, frames.encode_command(CONTROL, Mode.NOMINAL, counter=15)),
        message(frames.CTRL_HB, frames.encode_heartbeat(heartbeat, counter=4)),
        message(
            frames.IDENT_CONTROLLER, frames.encode_controller_identity(Identity(77, 5), counter=0)
        ),
    ):
        inbox.accept(each, 20)
    assert inbox.command == CommandSnapshot(CONTROL, Mode.NOMINAL, counter=15, arrival_ns=20)
    assert inbox.heartbeat == HeartbeatSnapshot(*heartbeat, counter=4, arrival_ns=20)
    assert inbox.peer == PeerIdentity(77, 5, counter=0, arrival_ns=20)
    assert sum(inbox.counts) == 0


def test_a_controller_that_repeats_itself_leaves_the_old_arrival() -> None:
    """So a stuck controller looks as silent as a dead one, and the vehicle brakes."""
    inbox = CommandInbox()
    frame = frames.encode_command(CONTROL, Mode.NOMINAL, 3)
    for tick in range(10):
        inbox.accept(message(frames.ACT_CMD, frame), tick * PERIOD_NS)
    assert inbox.command is not None
    assert inbox.command.arrival_ns == 0
    assert inbox.counts.repeated == 9


def test_a_command_with_nan_leaves_the_old_command() -> None:
    inbox = CommandInbox()
    inbox.accept(message(frames.ACT_CMD, frames.encode_command(CONTROL, Mode.NOMINAL, 3)), 0)
    broken = CONTROL._replace(steer_rad=nan)
    inbox.accept(message(frames.ACT_CMD, frames.encode_command(broken, Mode.NOMINAL, 4)), 1)
    assert inbox.command is not None
    assert inbox.command.arrival_ns == 0
    assert inbox.counts.out_of_range == 1


@pytest.mark.parametrize(
    ("codec", "box"),
    [
        (frames.ACT_FB, Inbox),
        (frames.MISSION, Inbox),
        (frames.IDENT_VEHICLE, Inbox),
        (frames.CTRL_HB, CommandInbox),
        (frames.IDENT_CONTROLLER, CommandInbox),
    ],
    ids=lambda value: getattr(value, "name", None) or value.__name__,
)
def test_a_frame_without_values_is_counted_and_changes_nothing(
    codec: MessageCodec, box: type[Inbox | CommandInbox]
) -> None:
    inbox = box()
    inbox.accept(message(codec, codec.encode([nan] * len(codec.signals), 0, 1)), 0)
    assert inbox.counts.out_of_range == 1
    assert set(snapshots(inbox)) == {None}


def test_neither_box_listens_to_its_own_side() -> None:
    inbox, command_inbox = Inbox(), CommandInbox()
    command = message(frames.ACT_CMD, frames.encode_command(CONTROL, Mode.NOMINAL, 3))
    inbox.accept(command, 0)
    for each in state_messages(5):
        command_inbox.accept(each, 0)
    assert sum(inbox.counts) == sum(command_inbox.counts) == 0
    assert command_inbox.command is None


@pytest.mark.parametrize("box", [Inbox, CommandInbox])
def test_a_bus_that_fails_is_explained_and_leaves_the_box_as_it_was(
    box: type[Inbox | CommandInbox],
) -> None:
    inbox = box()
    bus = open_bus("virtual", "failing")
    bus.shutdown()
    assert inbox.last_failure == ""
    assert inbox.drain(bus, 0) == 0
    assert "closed" in inbox.last_failure
    assert inbox.counts.receive_failures == 1
