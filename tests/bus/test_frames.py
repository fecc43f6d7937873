"""Contract types survive the bus; what must not be used comes out as None."""

from math import inf, nan, radians

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rt_controller.bus import frames
from rt_controller.bus.frames import Fault, Heartbeat, Identity, Mission, RoadSample
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import ControlInput, Mode, PathReference, VehicleState

STATE = VehicleState(22.22, -0.313, 0.1234, 0.5555, -0.25, 0.0105)
ROAD = RoadSample(0.001, 1_234_500_000, 7, False)
PATH = PathReference(1.25, -0.04, 0.0012, -3.4e-5, 22.222, -0.5)
CONTROL = ControlInput(0.31, 0.0, radians(12.5))
seeded = settings(derandomize=True, deadline=None)


def _bounds(name: str) -> tuple[float, float]:
    return getattr(INPUT_LIMITS.lower, name), getattr(INPUT_LIMITS.upper, name)


@seeded
@given(
    throttle=st.floats(*_bounds("throttle")),
    brake_n=st.floats(*_bounds("brake_n")),
    steer_rad=st.floats(*_bounds("steer_rad")),
    mode=st.sampled_from(Mode),
    counter=st.integers(0, 15),
)
def test_every_allowed_command_arrives_within_half_an_lsb(
    throttle: float, brake_n: float, steer_rad: float, mode: Mode, counter: int
) -> None:
    control = ControlInput(throttle, brake_n, steer_rad)
    command = frames.decode_command(frames.encode_command(control, mode, counter))
    assert command is not None
    assert command.mode is mode
    assert command.control.throttle == pytest.approx(throttle, abs=1.0001e-5)
    assert command.control.brake_n == pytest.approx(brake_n, abs=0.0012501)
    assert command.control.steer_rad == pytest.approx(steer_rad, abs=radians(0.0020001))


@pytest.mark.parametrize("bad", [nan, inf, -inf, 999.0])
@pytest.mark.parametrize("field", ControlInput._fields)
def test_a_command_with_an_impossible_value_is_no_command(field: str, bad: float) -> None:
    control = CONTROL._replace(**{field: bad})
    assert frames.decode_command(frames.encode_command(control, Mode.NOMINAL, 0)) is None


@pytest.mark.parametrize("nibble", range(len(Mode), 16))
def test_a_command_of_an_unknown_mode_is_no_command(nibble: int) -> None:
    assert frames.decode_command(frames.ACT_CMD.encode((0.1, 0.0, 0.0), 0, nibble)) is None


def test_the_state_arrives_within_half_an_lsb_and_in_the_order_of_the_contract() -> None:
    first = frames.decode_state_a(frames.encode_state_a(STATE, 4))
    second = frames.decode_state_b(frames.encode_state_b(STATE, 4))
    assert first is not None
    assert second is not None
    half_lsb = VehicleState(0.0025, 0.0005, 0.5e-4, 0.5e-4, 0.0005, 0.5e-4)
    for sent, received, tolerance in zip(STATE, (*first, *second), half_lsb, strict=True):
        assert abs(sent - received) <= tolerance * 1.0001


@pytest.mark.parametrize("bad", [nan, inf, 1000.0])
@pytest.mark.parametrize("field", VehicleState._fields)
def test_a_state_frame_with_an_impossible_value_must_not_be_used(field: str, bad: float) -> None:
    state = STATE._replace(**{field: bad})
    decoded = (
        frames.decode_state_a(frames.encode_state_a(state, 0)),
        frames.decode_state_b(frames.encode_state_b(state, 0)),
    )
    is_in_second = VehicleState._fields.index(field) >= 3
    assert [part is None for part in decoded] == [not is_in_second, is_in_second]


def test_a_state_that_its_sender_disowns_must_not_be_used() -> None:
    assert frames.decode_state_a(frames.encode_state_a(STATE, 0, is_valid=False)) is None
    assert frames.decode_state_b(frames.encode_state_b(STATE, 0, is_valid=False)) is None
    assert frames.decode_state_c(frames.encode_state_c(ROAD, 0, is_valid=False)) is None


@pytest.mark.parametrize("echo", [None, 0, 15])
@pytest.mark.parametrize("is_braking", [False, True])
def test_the_road_sample_arrives(echo: int | None, is_braking: bool) -> None:
    road = ROAD._replace(command_echo=echo, is_watchdog_braking=is_braking)
    assert frames.decode_state_c(frames.encode_state_c(road, 2)) == road


@pytest.mark.parametrize("field", ["curvature_per_m"])
def test_a_road_without_curvature_must_not_be_used(field: str) -> None:
    assert frames.decode_state_c(frames.encode_state_c(ROAD._replace(**{field: nan}), 0)) is None


@seeded
@given(st.integers(0, 2**63))
def test_the_sample_time_wraps_and_keeps_a_tenth_of_a_millisecond(sample_time_ns: int) -> None:
    road = frames.decode_state_c(
        frames.encode_state_c(ROAD._replace(sample_time_ns=sample_time_ns), 0)
    )
    assert road is not None
    assert 0 <= sample_time_ns % frames.SAMPLE_TIME_WRAP_NS - road.sample_time_ns < 100_000


def test_sample_time_wraps_at_6553_5_ms() -> None:
    """One less than the raw field holds: its last value means "not available"."""
    assert frames.SAMPLE_TIME_WRAP_NS == 6_553_500_000


def test_the_path_arrives_close_enough_to_drive_on() -> None:
    """The path decoded is within 2 mm of the path sent over 20 m."""
    head = frames.decode_reference_path(frames.encode_reference_path(PATH, 1))
    tail = frames.decode_reference_speed(frames.encode_reference_speed(PATH, 1))
    assert head is not None
    assert tail is not None
    received = PathReference(*head, *tail)
    for distance_m in (0.0, 5.0, 10.0, 20.0):
        deviation_m = sum((received[power] - PATH[power]) * distance_m**power for power in range(4))
        assert abs(deviation_m) < 0.002
    assert received.v_mps == pytest.approx(PATH.v_mps, abs=0.001001)
    assert received.a_mps2 == pytest.approx(PATH.a_mps2, abs=0.0005001)


@pytest.mark.parametrize("field", PathReference._fields)
def test_a_reference_with_an_impossible_value_must_not_be_used(field: str) -> None:
    path = PATH._replace(**{field: 500.0})
    decoded = (
        frames.decode_reference_path(frames.encode_reference_path(path, 0)),
        frames.decode_reference_speed(frames.encode_reference_speed(path, 0)),
    )
    is_in_second = PathReference._fields.index(field) >= 3
    assert [part is None for part in decoded] == [not is_in_second, is_in_second]


@pytest.mark.parametrize("is_engaged", [False, True])
@pytest.mark.parametrize("is_reset_requested", [False, True])
def test_the_mission_arrives(is_engaged: bool, is_reset_requested: bool) -> None:
    mission = Mission(is_engaged, is_reset_requested, 17, 500_000_000)
    assert frames.decode_mission(frames.encode_mission(mission, 3)) == mission


def test_a_mission_that_would_stand_for_too_long_is_no_mission() -> None:
    mission = Mission(True, False, 1, 61_000_000_000)
    assert frames.decode_mission(frames.encode_mission(mission, 3)) is None


@pytest.mark.parametrize("raw", [2, 37, 254, 255])
def test_an_engage_byte_that_is_neither_on_nor_off_is_no_mission(raw: int) -> None:
    frame = bytearray(frames.encode_mission(Mission(True, False, 1, 0), 3))
    frame[2] = raw
    assert frames.decode_mission(frame) is None


def test_the_feedback_arrives() -> None:
    applied = frames.decode_feedback(frames.encode_feedback(CONTROL, 0))
    assert applied is not None
    assert applied == pytest.approx(CONTROL, abs=1e-4)
    broken = CONTROL._replace(brake_n=nan)
    assert frames.decode_feedback(frames.encode_feedback(broken, 0)) is None


@pytest.mark.parametrize(
    "heartbeat",
    [
        Heartbeat(Mode.NOMINAL, Fault(0), 730_000, 24_900_000, 11),
        Heartbeat(Mode.SAFE_STOP, Fault.STATE_STALE | Fault.BUS_FAULT, None, None, None),
        Heartbeat(Mode.STANDBY, ~Fault(0), 0, 0, 0),
    ],
)
def test_the_heartbeat_arrives(heartbeat: Heartbeat) -> None:
    assert frames.decode_heartbeat(frames.encode_heartbeat(heartbeat, 5)) == heartbeat


def test_a_time_too_long_for_the_heartbeat_arrives_as_missing() -> None:
    heartbeat = Heartbeat(Mode.NOMINAL, Fault(0), 10**9, 10**10, 3)
    decoded = frames.decode_heartbeat(frames.encode_heartbeat(heartbeat, 5))
    assert decoded == Heartbeat(Mode.NOMINAL, Fault(0), None, None, 3)


@pytest.mark.parametrize("model_hash", [None, 0, 65_534])
def test_identities_arrive(model_hash: int | None) -> None:
    identity = Identity(0xDEADBEEF, model_hash)
    as_controller = frames.encode_controller_identity(identity, 0)
    as_vehicle = frames.encode_vehicle_identity(identity, 0)
    assert frames.decode_controller_identity(as_controller) == identity
    assert frames.decode_vehicle_identity(as_vehicle) == identity
