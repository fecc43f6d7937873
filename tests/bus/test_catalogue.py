"""Every content survives the bus; frames that must not be used are decoded as None."""

from math import inf, nan, radians

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_frames import BEND, CONTROL, PATH, SAMPLE, decode_frames, encode_frames, round_trip

from rt_controller.bus.messages import (
    COMMAND,
    CONTROLLER_IDENTITY,
    FEEDBACK,
    HEARTBEAT,
    MISSION,
    PREVIEW,
    REFERENCE,
    SAMPLE_TIME_WRAP_NS,
    STATE,
    VEHICLE_IDENTITY,
    Command,
    Heartbeat,
    Identity,
    Mission,
)
from rt_controller.contract.faults import Fault, Refusal
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import (
    ControlInput,
    CurvaturePreview,
    Mode,
    PathReference,
    VehicleState,
)

seeded = settings(derandomize=True, deadline=None)


def _bounds(name: str) -> tuple[float, float]:
    return getattr(INPUT_LIMITS.lower, name), getattr(INPUT_LIMITS.upper, name)


@seeded
@given(
    throttle=st.floats(*_bounds("throttle")),
    brake_n=st.floats(*_bounds("brake_n")),
    steer_rad=st.floats(*_bounds("steer_rad")),
    mode=st.sampled_from(Mode),
)
def test_every_allowed_command_arrives_within_half_an_lsb(
    throttle: float, brake_n: float, steer_rad: float, mode: Mode
) -> None:
    command = round_trip(COMMAND, Command(ControlInput(throttle, brake_n, steer_rad), mode))
    assert command is not None
    assert command.mode is mode
    assert command.control.throttle == pytest.approx(throttle, abs=1.0001e-5)
    assert command.control.brake_n == pytest.approx(brake_n, abs=0.0012501)
    assert command.control.steer_rad == pytest.approx(steer_rad, abs=radians(0.010001))


@pytest.mark.parametrize("bad", [nan, inf, -inf, 999.0])
@pytest.mark.parametrize("field", ControlInput._fields)
def test_a_command_with_an_impossible_value_is_not_decoded(field: str, bad: float) -> None:
    control = CONTROL._replace(**{field: bad})
    assert round_trip(COMMAND, Command(control, Mode.NOMINAL)) is None
    assert round_trip(FEEDBACK, control) is None


@pytest.mark.parametrize("nibble", [len(Mode), 15])
@pytest.mark.parametrize("message", [COMMAND, HEARTBEAT])
def test_an_unknown_mode_is_not_decoded(message, nibble: int) -> None:
    (codec,) = message.codecs
    assert decode_frames(message, codec.encode([0.0] * len(codec.signals), 0, nibble)) is None


def test_the_state_arrives_within_half_an_lsb_and_in_the_order_of_the_contract() -> None:
    sample = round_trip(STATE, SAMPLE)
    assert sample is not None
    half_lsb = VehicleState(0.0025, 0.0005, 0.5e-4, 0.5e-4, 0.0005, 0.5e-4)
    for sent, received, tolerance in zip(SAMPLE.state, sample.state, half_lsb, strict=True):
        assert abs(sent - received) <= tolerance * 1.0001
    assert sample[1:4] == pytest.approx(SAMPLE[1:4])
    assert sample[4:] == SAMPLE[4:]


@pytest.mark.parametrize("bad", [nan, inf, 1000.0])
@pytest.mark.parametrize("field", VehicleState._fields)
def test_only_the_frame_with_an_impossible_value_is_refused(field: str, bad: float) -> None:
    sample = SAMPLE._replace(state=SAMPLE.state._replace(**{field: bad}))
    frames = encode_frames(STATE, sample, 0)
    refused = [codec.read(frame) is None for codec, frame in zip(STATE.codecs, frames, strict=True)]
    is_in_first = field in VehicleState._fields[:3]
    assert refused == [is_in_first, not is_in_first, False]


def test_every_frame_that_its_sender_marks_as_invalid_is_refused() -> None:
    for codec, frame in zip(
        STATE.codecs, encode_frames(STATE, SAMPLE, 0, is_valid=False), strict=True
    ):
        assert codec.check(frame) >= 0
        assert codec.read(frame) is None


@pytest.mark.parametrize("echo", [None, 0, 127])
@pytest.mark.parametrize("is_braking", [False, True])
@pytest.mark.parametrize("refusals", [Refusal(0), Refusal.LATE, Refusal.PEDALS | Refusal.MODE])
def test_command_echo_braking_and_refusals_arrive(
    echo: int | None, is_braking: bool, refusals: Refusal
) -> None:
    sent = SAMPLE._replace(command_echo=echo, is_watchdog_braking=is_braking, refusals=refusals)
    sample = round_trip(STATE, sent)
    assert sample is not None
    assert sample[3:] == (echo, is_braking, refusals)


@seeded
@given(st.integers(0, 2**63))
def test_the_sample_time_wraps_and_keeps_a_tenth_of_a_millisecond(sample_time_ns: int) -> None:
    sample = round_trip(STATE, SAMPLE._replace(sample_time_ns=sample_time_ns))
    assert sample is not None
    assert 0 <= sample_time_ns % SAMPLE_TIME_WRAP_NS - sample.sample_time_ns < 100_000


def test_the_decoded_path_is_within_2_mm_of_the_path_sent_over_20_m() -> None:
    sent = PathReference(1.25, -0.04, 0.0012, -3.4e-5, 22.222, -0.5)
    received = round_trip(REFERENCE, sent)
    assert received is not None
    for distance_m in (0.0, 5.0, 10.0, 20.0):
        deviation_m = sum((received[power] - sent[power]) * distance_m**power for power in range(4))
        assert abs(deviation_m) < 0.002
    assert received.v_mps == pytest.approx(sent.v_mps, abs=0.001001)
    assert received.a_mps2 == pytest.approx(sent.a_mps2, abs=0.0005001)


@pytest.mark.parametrize("field", PathReference._fields)
def test_a_reference_with_an_impossible_value_is_not_decoded(field: str) -> None:
    assert round_trip(REFERENCE, PATH._replace(**{field: 500.0})) is None


@seeded
@given(
    spacing_m=st.floats(0.05, 65.5), values=st.lists(st.floats(-0.16, 0.16), min_size=5, max_size=5)
)
def test_the_road_ahead_arrives_within_half_an_lsb(spacing_m: float, values: list[float]) -> None:
    received = round_trip(PREVIEW, CurvaturePreview(spacing_m, *values))
    assert received is not None
    assert received.spacing_m == pytest.approx(spacing_m, abs=0.00050001)
    assert received[1:] == pytest.approx(values, abs=2.50001e-6)


@seeded
@given(st.floats(-0.16, 0.16))
def test_the_curvature_of_a_circle_is_that_of_the_state(curvature_per_m: float) -> None:
    sample = round_trip(STATE, SAMPLE._replace(curvature_per_m=curvature_per_m))
    preview = round_trip(PREVIEW, CurvaturePreview(3.0, *[curvature_per_m] * 5))
    assert sample is not None
    assert preview is not None
    assert set(preview[1:]) == {sample.curvature_per_m}


@pytest.mark.parametrize("bad", [nan, inf, 0.2])
@pytest.mark.parametrize("first_missing", [2, 5])
def test_from_a_missing_value_on_the_curvature_ahead_is_the_last_one(
    first_missing: int, bad: float
) -> None:
    sent = CurvaturePreview(*BEND[:first_missing], bad, *BEND[first_missing + 1 :])
    known = BEND[:first_missing]
    assert round_trip(PREVIEW, sent) == pytest.approx(known + known[-1:] * (6 - first_missing))


@pytest.mark.parametrize("field", ["spacing_m", "k0_per_m"])
def test_without_spacing_or_first_value_nothing_is_known(field: str) -> None:
    assert round_trip(PREVIEW, BEND._replace(**{field: nan})) is None


def test_a_vehicle_without_a_road_ahead_sends_not_available() -> None:
    """With values that are not available, or all zero as before a first calculation."""
    for frame, codec in zip(encode_frames(PREVIEW, None, 3), PREVIEW.codecs, strict=True):
        assert codec.read(frame) is not None  # no fault: the frame says that nothing is known
    assert round_trip(PREVIEW, None) is None
    zeros = [codec.encode([0.0] * 3, 3, 1) for codec in PREVIEW.codecs]
    assert decode_frames(PREVIEW, *zeros) is None


@pytest.mark.parametrize("is_engaged", [False, True])
@pytest.mark.parametrize("is_reset_requested", [False, True])
def test_the_mission_arrives(is_engaged: bool, is_reset_requested: bool) -> None:
    mission = Mission(is_engaged, is_reset_requested, 17, 500_000_000)
    assert round_trip(MISSION, mission) == mission


def test_a_mission_that_is_valid_for_too_long_is_not_decoded() -> None:
    assert round_trip(MISSION, Mission(True, False, 1, 61_000_000_000)) is None


@pytest.mark.parametrize("raw", [2, 255])
def test_an_engage_byte_that_is_neither_on_nor_off_is_not_decoded(raw: int) -> None:
    frame = bytearray(encode_frames(MISSION, Mission(True, False, 1, 0), 3)[0])
    frame[2] = raw
    assert decode_frames(MISSION, frame) is None


def test_the_feedback_arrives() -> None:
    assert round_trip(FEEDBACK, CONTROL) == pytest.approx(CONTROL, abs=1e-4)


@pytest.mark.parametrize(
    "heartbeat",
    [
        Heartbeat(Mode.NOMINAL, Fault(0), 0, 750_000, 24_000_000, 11),
        Heartbeat(Mode.SAFE_STOP, Fault.STATE_STALE | Fault.BUS_FAULT, 127, None, None, None),
        Heartbeat(Mode.STANDBY, ~Fault.STATE_STALE, 16, 0, 0, 0),
    ],
)
def test_the_heartbeat_arrives(heartbeat: Heartbeat) -> None:
    assert round_trip(HEARTBEAT, heartbeat) == heartbeat


def test_a_time_too_long_for_the_heartbeat_arrives_as_missing() -> None:
    heartbeat = Heartbeat(Mode.NOMINAL, Fault(0), 5, 10**9, 10**10, 3)
    assert round_trip(HEARTBEAT, heartbeat) == Heartbeat(Mode.NOMINAL, Fault(0), 5, None, None, 3)


@pytest.mark.parametrize("model_hash", [None, 0, 65_534])
@pytest.mark.parametrize("message", [CONTROLLER_IDENTITY, VEHICLE_IDENTITY])
def test_identities_arrive(message, model_hash: int | None) -> None:
    identity = Identity(0xDEADBEEF, model_hash)
    assert round_trip(message, identity) == identity
