"""From the frames of the car to the frames of the contract, and back."""

import pytest
from car_gateway import REAR_AXLE, send_command
from own_car import VALUES, command_reader, example, state_writer

from rt_controller.bus.messages import (
    FEEDBACK,
    MISSION,
    PREVIEW,
    REFERENCE,
    STATE,
    VEHICLE_IDENTITY,
    Node,
)
from rt_controller.bus.receive import Inbox
from rt_controller.bus.send import Outbox
from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_NS
from rt_controller.gateway.car_end import CarEnd
from rt_controller.gateway.lateral_speed import LateralSpeed
from rt_controller.mapping.signal_frames import FrameQueue


class Rig:
    """A car end, the car's writer, and what the controller receives."""

    def __init__(self):
        self.car = example()
        self.queue = FrameQueue()
        self.end = CarEnd(self.car, LateralSpeed(REAR_AXLE), self.queue)
        self.inbox = Inbox(Node.CONTROLLER)
        self.writer = state_writer(self.car)
        self.tick = 0

    def drive(self, ticks=1, without=(), **changes):
        """Ticks in which the car sends, except the messages of these ids; newest state content."""
        values = {**VALUES, **{name.replace("__", "."): value for name, value in changes.items()}}
        for _ in range(ticks):
            now_ns = self.tick * PERIOD_NS
            for frame in self.writer.frames(values, self.tick):
                if frame.arbitration_id not in without:
                    self.end.accept(frame, now_ns)
            self.end.send(now_ns)
            while self.queue.frames:
                self.inbox.accept(self.queue.frames.popleft(), now_ns)
            self.tick += 1
        return self.inbox.newest(STATE)


@pytest.fixture
def rig():
    return Rig()


def test_the_controller_receives_every_message(rig):
    rig.drive(2)
    for message in (STATE, REFERENCE, PREVIEW, FEEDBACK, MISSION, VEHICLE_IDENTITY):
        assert rig.inbox.newest(message) is not None
    path = rig.inbox.newest(REFERENCE).content
    assert path.c0_m == pytest.approx(0.5, abs=1e-3)
    assert path.v_mps == pytest.approx(22.0, abs=1e-2)
    assert rig.inbox.newest(MISSION).content.is_engaged


def test_missing_states_are_computed_from_pose_line_and_yaw_rate(rig):
    """On a circle of 1000 m, 0.5 m to its left, 0.01 rad to the left of its tangent."""
    from math import cos, sin

    along, radius = 0.02, 999.5
    at = {
        "pose__x": radius * sin(along),
        "pose__y": 1000.0 - radius * cos(along),
        "pose__yaw": along + 0.01,
    }
    state = rig.drive(1, **at).content
    assert state.state.ey_m == pytest.approx(0.5, abs=3e-3)
    assert state.state.epsi_rad == pytest.approx(0.01, abs=3e-4)
    assert state.curvature_per_m == pytest.approx(1e-3, abs=2e-5)
    assert state.state.ds_m == pytest.approx(20.0 * 0.025, rel=2e-3)
    assert state.state.vy_mps == pytest.approx((1.86 - 0.005 * 400.0) * 0.02, abs=2e-3)


def test_a_slow_pose_is_moved_on_between_two_samples(rig):
    """The pose comes every 50 ms; the car drives along x without turning."""
    pose = {"pose__x": 50.0, "pose__y": 1.0, "pose__yaw": 0.2, "states__yaw_rate_radps": 0.0}
    first = rig.drive(1, **pose).content.state
    second = rig.drive(1, **pose).content.state
    assert second.ey_m - first.ey_m == pytest.approx(20.0 * 0.025 * 0.15, abs=5e-3)


def test_no_state_is_sent_when_the_speed_is_missing_for_longer_than_its_gap(rig):
    before = rig.drive(2)
    assert rig.drive(3, without=(0x123,)).counter > before.counter
    last = rig.drive(1, without=(0x123,))
    assert rig.drive(5, without=(0x123,)) is last
    rig.drive(1)  # the counter has gone on, too far for the first frame after the silence
    assert rig.drive(1).counter == rig.tick - 1


def test_a_pose_that_jumps_is_not_valid(rig):
    rig.drive(2)
    before = rig.inbox.out_of_range(STATE)
    rig.drive(2, pose__x=60.0, pose__y=1.8)
    assert rig.inbox.out_of_range(STATE) > before


def test_the_car_stops_before_the_end_of_an_open_line(rig):
    rig.drive(4, pose__x=380.0, pose__y=75.0, pose__yaw=0.385)
    path = rig.inbox.newest(REFERENCE).content
    assert path.v_mps < 6.5
    assert path.a_mps2 == pytest.approx(-2.0, abs=0.01)


def test_a_command_of_the_contract_becomes_frames_of_the_car(rig):
    rig.drive(1)
    queue = FrameQueue()
    sender = Outbox(queue, Node.CONTROLLER)
    for tick in range(2):  # the first frame of a sender is not used yet
        send_command(sender, ControlInput(0.0, 40.0, -0.2), tick)
    assert [rig.end.accept_command(frame, 0) for frame in queue.frames][-1]
    reader, found = command_reader(rig.car), {}
    for frame in rig.end.command_frames(*rig.end.command.content):
        found |= reader.read(frame)
    assert found["commands.brake_n"] == pytest.approx(40.0, abs=0.1)
    assert found["commands.steer_rad"] == pytest.approx(-0.2, abs=1e-3)
    assert found["driving"] == 1.0
    rig.drive(1)
    assert rig.inbox.newest(STATE).content.command_echo == 1


def test_feedback_is_sent_once_and_only_when_all_of_it_is_new(rig):
    rig.drive(2)
    found = rig.inbox.newest(FEEDBACK)
    assert rig.drive(1) is not None
    assert rig.inbox.newest(FEEDBACK) is not found
    found = rig.inbox.newest(FEEDBACK)
    rig.drive(2, without=(0x323,))  # PedalsAndWheel
    assert rig.inbox.newest(FEEDBACK) is found


def test_a_mission_that_ends_is_sent_at_once(rig):
    rig.drive(5)
    assert rig.inbox.newest(MISSION).content.is_engaged
    for message in rig.writer.frames(VALUES | {"mission.engage": 0.0}, 0):
        rig.end.accept(message, rig.tick * PERIOD_NS)
    rig.drive(1, without=(0x322,))  # DriverPanel; the mission is otherwise due every fourth tick
    assert not rig.inbox.newest(MISSION).content.is_engaged
