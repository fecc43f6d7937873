"""From the frames of the car to those of the contract and back; place, motion and v_y."""

from math import cos, isnan, nan, pi, sin
from types import SimpleNamespace

import numpy as np
import pytest
from car_gateway import GatewayRig, send_command
from own_car import VALUES

from rt_controller.bus.messages import (
    FEEDBACK,
    MISSION,
    PREVIEW,
    REFERENCE,
    STATE,
    VEHICLE_IDENTITY,
    Node,
)
from rt_controller.bus.send import Outbox
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.limits import DEFAULT_GEOMETRY
from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_NS, PERIOD_S
from rt_controller.gateway.lateral_speed import identify
from rt_controller.gateway.road_place import PlaceMeasured
from rt_controller.gateway.samples import LARGEST_MPS2, Motion, MotionHistory, Sample, SpeedSlope
from rt_controller.mapping.lateral_speed import LateralSpeed, RearAxle
from rt_controller.mapping.signal_frames import FrameQueue
from rt_controller.model.bundle import Bundle


@pytest.fixture
def rig():
    return GatewayRig()


def states(rig, ticks=1, without=(), **changes):
    """The newest state after ticks in which the car sends, except the messages of these ids."""
    rig.values = VALUES | {name.replace("__", "."): value for name, value in changes.items()}
    rig.change = lambda frame: frame.arbitration_id not in without
    for _ in range(ticks):
        rig.drive()
    return rig.inbox.newest(STATE)


def test_the_controller_receives_every_message(rig):
    states(rig, 2)
    for message in (STATE, REFERENCE, PREVIEW, FEEDBACK, MISSION, VEHICLE_IDENTITY):
        assert rig.inbox.newest(message) is not None
    path = rig.inbox.newest(REFERENCE).content
    assert path.c0_m == pytest.approx(0.5, abs=1e-3)
    assert path.v_mps == pytest.approx(22.0, abs=1e-2)
    assert rig.inbox.newest(MISSION).content.is_engaged


def test_missing_states_are_computed_from_pose_line_and_yaw_rate(rig):
    """On a circle of 1000 m, 0.5 m to its left, 0.01 rad to the left of its tangent."""
    along, radius = 0.02, 999.5
    at = {
        "pose__x": radius * sin(along),
        "pose__y": 1000.0 - radius * cos(along),
        "pose__yaw": along + 0.01,
    }
    state = states(rig, 1, **at).content
    assert state.state.ey_m == pytest.approx(0.5, abs=3e-3)
    assert state.state.epsi_rad == pytest.approx(0.01, abs=3e-4)
    assert state.curvature_per_m == pytest.approx(1e-3, abs=2e-5)
    assert state.state.ds_m == pytest.approx(20.0 * 0.025, rel=2e-3)
    assert state.state.vy_mps == pytest.approx((1.86 - 0.005 * 400.0) * 0.02, abs=2e-3)


def test_a_slow_pose_is_moved_on_between_two_samples(rig):
    """The pose comes every 50 ms; the car drives along x without turning."""
    pose = {"pose__x": 50.0, "pose__y": 1.0, "pose__yaw": 0.2, "states__yaw_rate_radps": 0.0}
    first = states(rig, 1, **pose).content.state
    second = states(rig, 1, **pose).content.state
    assert second.ey_m - first.ey_m == pytest.approx(20.0 * 0.025 * 0.15, abs=5e-3)


def test_no_state_is_sent_when_the_speed_is_missing_for_longer_than_its_gap(rig):
    before = states(rig, 2)
    assert states(rig, 3, without=(0x123,)).counter > before.counter
    last = states(rig, 1, without=(0x123,))
    assert states(rig, 5, without=(0x123,)) is last
    states(rig, 1)  # the counter has gone on, too far for the first frame after the silence
    assert states(rig, 1).counter == rig.tick - 1


def test_a_pose_that_jumps_is_not_valid(rig):
    states(rig, 2)
    before = rig.inbox.out_of_range(STATE)
    states(rig, 2, pose__x=60.0, pose__y=1.8)
    assert rig.inbox.out_of_range(STATE) > before


def test_the_car_stops_before_the_end_of_an_open_line(rig):
    states(rig, 4, pose__x=380.0, pose__y=75.0, pose__yaw=0.385)
    path = rig.inbox.newest(REFERENCE).content
    assert path.v_mps < 6.5
    assert path.a_mps2 == pytest.approx(-2.0, abs=0.01)


def test_a_command_of_the_contract_becomes_frames_of_the_car(rig):
    states(rig, 1)
    queue = FrameQueue()
    sender = Outbox(queue, Node.CONTROLLER)
    for tick in range(2):  # the first frame of a sender is not used yet
        send_command(sender, ControlInput(0.0, 40.0, -0.2), tick)
    assert [rig.gateway.car_end.accept_command(frame, 0) for frame in queue.frames][-1]
    found = {}
    for frame in rig.gateway.car_end.command_frames(*rig.gateway.car_end.command.content):
        found |= rig.reader.read(frame)
    assert found["commands.brake_n"] == pytest.approx(40.0, abs=0.1)
    assert found["commands.steer_rad"] == pytest.approx(-0.2, abs=1e-3)
    assert found["driving"] == 1.0
    states(rig, 1)
    assert rig.inbox.newest(STATE).content.command_echo == 1


def test_feedback_is_sent_once_and_only_when_all_of_it_is_new(rig):
    states(rig, 2)
    found = rig.inbox.newest(FEEDBACK)
    assert states(rig, 1) is not None
    assert rig.inbox.newest(FEEDBACK) is not found
    found = rig.inbox.newest(FEEDBACK)
    states(rig, 2, without=(0x323,))  # PedalsAndWheel
    assert rig.inbox.newest(FEEDBACK) is found


def test_a_mission_that_ends_is_sent_at_once(rig):
    states(rig, 5)
    assert rig.inbox.newest(MISSION).content.is_engaged
    for message in rig.writer.frames(VALUES | {"mission.engage": 0.0}, 0):
        rig.gateway.car_end.accept(message, rig.tick * PERIOD_NS)
    states(rig, 1, without=(0x322,))  # DriverPanel; the mission is otherwise due every fourth tick
    assert not rig.inbox.newest(MISSION).content.is_engaged


MOTION = Motion(time_ns=0, vx_mps=20.0, vy_mps=0.0, yaw_rate_radps=0.0)


@pytest.mark.parametrize(
    ("ey_m", "curvature_per_m", "expected_m"),
    [
        (0.0, 0.0, 20.0 * PERIOD_S),
        (10.0, 0.02, 20.0 * PERIOD_S / 0.8),
        (10.0, 0.1, 20.0 * PERIOD_S / 0.05),  # at the centre of the bend: limited
    ],
)
def test_progress_is_finite_everywhere(ey_m, curvature_per_m, expected_m):
    values = {"states.ey_m": ey_m, "exogenous.curvature_per_m": curvature_per_m}
    measured = SimpleNamespace(newest=lambda name, ns: Sample(values.get(name, 0.0), ns))
    place = PlaceMeasured().locate(measured, MotionHistory(), MOTION)
    assert place.ds_m == pytest.approx(expected_m)


YAW_RATE = 0.4


def circle(periods, vx_mps=20.0):
    history = MotionHistory()
    for k in range(periods):
        history.add(Motion(k * PERIOD_NS, vx_mps, 0.0, YAW_RATE))
    return history


def test_the_heading_turns_by_the_yaw_rate_since_the_measurement():
    assert circle(10).turned(5 * PERIOD_NS) == pytest.approx(YAW_RATE * 4 * 0.025)
    assert circle(10).turned(9 * PERIOD_NS) == 0.0
    assert circle(10).turned(round(8.5 * PERIOD_NS)) == pytest.approx(YAW_RATE * 0.5 * 0.025)


def test_the_position_moves_along_the_circle():
    history, now_s, then_s = circle(10), 9 * 0.025, 2 * 0.025
    radius = 20.0 / YAW_RATE
    yaw = YAW_RATE * now_s
    x = radius * (sin(yaw) - sin(YAW_RATE * then_s))
    y = radius * (cos(YAW_RATE * then_s) - cos(yaw))
    assert history.moved(2 * PERIOD_NS, yaw) == pytest.approx((x, y), abs=1e-4)


def test_a_measurement_of_the_present_is_not_moved():
    assert circle(3).moved(2 * PERIOD_NS, 1.0) == (0.0, 0.0)
    assert MotionHistory().moved(0, 0.0) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("speeds_mps", "expected_mps2", "share"),
    [
        ([20.0], 0.0, 0.0),
        ([20.0] * 50, 0.0, 0.0),
        ([20.0 - 2.0 * PERIOD_S * k for k in range(50)], -2.0, 1e-6),
        ([20.0 + 0.2 * (k // 4) for k in range(61)], 2.0, 0.1),  # in steps
        ([20.0, 25.0], LARGEST_MPS2, 0.0),
        # a speed that is not available does not stay in the slope
        ([20.0, nan], 0.0, 0.0),
        ([20.0, nan, 20.0, 20.0 + PERIOD_S], 1.0, 1e-6),
    ],
)
def test_the_slope_of_the_wanted_speed_is_that_of_a_ramp_and_limited(
    speeds_mps, expected_mps2, share
):
    slope = SpeedSlope()
    found = [slope.mps2(v, k * PERIOD_NS) for k, v in enumerate(speeds_mps)]
    assert found[-1] == pytest.approx(expected_mps2, rel=share)


def test_a_gap_is_not_a_slope():
    slope = SpeedSlope()
    slope.mps2(20.0, 0)
    assert slope.mps2(25.0, 10 * 10**9) == 0.0


MASS_KG, INERTIA, FRONT_M, REAR_M = 1800.0, 3000.0, 1.2, 1.7
FRONT_STIFFNESS, REAR_STIFFNESS = 110e3, 130e3
CAR = RearAxle(
    REAR_M, MASS_KG * FRONT_M / ((FRONT_M + REAR_M) * REAR_STIFFNESS), INERTIA / (MASS_KG * FRONT_M)
)


def single_track(vx_mps, steps):
    """(v_y, yaw rate) every 25 ms of a linear single-track car in a sine of 1 Hz."""
    vy = yaw_rate = 0.0
    dt, found = 2.5e-4, []
    for k in range(100 * steps):
        if k % 100 == 0:
            found.append((vy, yaw_rate))
        wheel = 0.02 * sin(2.0 * pi * k * dt)
        front = FRONT_STIFFNESS * (wheel - (vy + FRONT_M * yaw_rate) / vx_mps)
        rear = -REAR_STIFFNESS * (vy - REAR_M * yaw_rate) / vx_mps
        vy += dt * ((front + rear) / MASS_KG - vx_mps * yaw_rate)
        yaw_rate += dt * (FRONT_M * front - REAR_M * rear) / INERTIA
    return np.array(found)


@pytest.mark.parametrize("vx_mps", [17.0, 22.0, 33.0])
def test_the_estimate_is_that_of_a_single_track_car(vx_mps):
    motion, estimator = single_track(vx_mps, 80), LateralSpeed(CAR)
    found = np.array([estimator.update(vx_mps, yaw_rate) for _, yaw_rate in motion])
    assert np.max(np.abs(found - motion[:, 0])) < 0.02 * np.max(np.abs(motion[:, 0]))


def test_the_rear_axle_of_a_slow_car_rolls_without_slip():
    estimator = LateralSpeed(CAR)
    assert estimator.update(0.5, 0.1) == pytest.approx(0.1 * REAR_M)
    assert estimator.update(0.0, 0.1) == 0.0


def test_a_missing_value_gives_none_and_is_forgotten():
    estimator = LateralSpeed(CAR)
    steady = estimator.update(20.0, 0.1)
    estimator.update(20.0, -0.4)
    assert isnan(estimator.update(float("nan"), 0.1))
    assert estimator.update(20.0, 0.1) == steady


def test_the_constants_come_from_the_learned_model():
    found = identify(Bundle.load("mdk-net"), DEFAULT_GEOMETRY)
    assert found.rear_axle_m == DEFAULT_GEOMETRY.rear_axle_m
    assert 0.004 < found.slip_s2_per_m < 0.0065
    assert 0.2 < found.inertia_m < 1.2


def test_a_linear_model_is_refused_with_the_remedy():
    with pytest.raises(ConfigError, match=r"expected vy_mps, .*rear_slip_s2_per_m"):
        identify(Bundle.load("lti"), DEFAULT_GEOMETRY)
