"""Every content survives the bus; frames that must not be used are decoded as None."""

from math import inf, nan, radians
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_frames import BEND, CONTROL, PATH, SAMPLE, decode_frames, encode_frames, round_trip

from rt_controller.bus.codec import FrameSpec
from rt_controller.bus.dbc import DBC_PATH
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
    Catalogue,
    Command,
    Heartbeat,
    Identity,
    Message,
    Mission,
    Node,
)
from rt_controller.bus.receive import Inbox
from rt_controller.bus.send import Outbox
from rt_controller.bus.transport import open_bus
from rt_controller.contract.faults import Fault, Refusal
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import (
    ControlInput,
    CurvaturePreview,
    Mode,
    PathReference,
    VehicleState,
)
from rt_controller.contract.timing import PERIOD_MS


@pytest.mark.parametrize("nibble", [len(Mode), 15])
@pytest.mark.parametrize("message", [COMMAND, HEARTBEAT])
def test_an_unknown_mode_is_not_decoded(message, nibble):
    (codec,) = message.codecs
    assert decode_frames(message, codec.encode([0.0] * len(codec.signals), 0, nibble)) is None


@pytest.mark.parametrize("bad", [nan, 1000.0])
@pytest.mark.parametrize("field", VehicleState._fields)
def test_only_the_frame_with_an_impossible_value_is_refused(field, bad):
    sample = SAMPLE._replace(state=SAMPLE.state._replace(**{field: bad}))
    frames = encode_frames(STATE, sample, 0)
    refused = [codec.read(frame) is None for codec, frame in zip(STATE.codecs, frames, strict=True)]
    is_in_first = field in VehicleState._fields[:3]
    assert refused == [is_in_first, not is_in_first, False]


@given(st.integers(0, 2**63))
def test_the_sample_time_wraps_and_keeps_a_tenth_of_a_millisecond(sample_time_ns):
    sample = round_trip(STATE, SAMPLE._replace(sample_time_ns=sample_time_ns))
    assert 0 <= sample_time_ns % SAMPLE_TIME_WRAP_NS - sample.sample_time_ns < 100_000


@pytest.mark.parametrize("bad", [nan, 0.2])
@pytest.mark.parametrize("first_missing", [2, 5])
def test_from_a_missing_value_on_the_curvature_ahead_is_the_last_one(first_missing, bad):
    sent = CurvaturePreview(*BEND[:first_missing], bad, *BEND[first_missing + 1 :])
    known = BEND[:first_missing]
    assert round_trip(PREVIEW, sent) == pytest.approx(known + known[-1:] * (6 - first_missing))


def test_a_vehicle_without_a_road_ahead_sends_not_available():
    """With values that are not available, or all zero as before a first calculation."""
    for frame, codec in zip(encode_frames(PREVIEW, None, 3), PREVIEW.codecs, strict=True):
        assert codec.read(frame) is not None  # no fault: the frame says that nothing is known
    assert round_trip(PREVIEW, None) is None
    zeros = [codec.encode([0.0] * 3, 3, 1) for codec in PREVIEW.codecs]
    assert decode_frames(PREVIEW, *zeros) is None


@pytest.mark.parametrize("raw", [2, 255])
def test_an_engage_byte_that_is_neither_on_nor_off_is_not_decoded(raw):
    frame = bytearray(encode_frames(MISSION, Mission(True, False, 1, 0), 3)[0])
    frame[2] = raw
    assert decode_frames(MISSION, frame) is None


BAD = [nan, inf, -inf, 999.0]


@pytest.mark.parametrize(
    ("message", "content"),
    [
        *((MISSION, Mission(*bits, 17, 500_000_000)) for bits in ((False, True), (True, False))),
        (HEARTBEAT, Heartbeat(Mode.NOMINAL, Fault(0), 0, 750_000, 24_000_000, 11)),
        (
            HEARTBEAT,
            Heartbeat(Mode.SAFE_STOP, Fault.STATE_STALE | Fault.BUS_FAULT, 127, *3 * [None]),
        ),
        (HEARTBEAT, Heartbeat(Mode.STANDBY, ~Fault.STATE_STALE, 16, 0, 0, 0)),
        *((CONTROLLER_IDENTITY, Identity(0xDEADBEEF, model)) for model in (None, 0, 65_534)),
        (VEHICLE_IDENTITY, Identity(0xDEADBEEF, None)),
        *(
            (STATE, SAMPLE._replace(is_watchdog_braking=True, refusals=each))
            for each in (Refusal.LATE, Refusal.PEDALS | Refusal.MODE)
        ),
        *((STATE, SAMPLE._replace(command_echo=echo)) for echo in (None, 0, 127)),
    ],
)
def test_what_is_counted_or_named_arrives_as_it_was_sent(message, content):
    names = (
        ("command_echo", "is_watchdog_braking", "refusals") if message is STATE else content._fields
    )
    arrived = round_trip(message, content)
    assert all(getattr(arrived, name) == getattr(content, name) for name in names)


@pytest.mark.parametrize(
    ("message", "content"),
    [
        *((COMMAND, Command(CONTROL._replace(throttle=bad), Mode.NOMINAL)) for bad in BAD),
        *((FEEDBACK, CONTROL._replace(**{field: nan})) for field in CONTROL._fields),
        *((REFERENCE, PATH._replace(**{field: 500.0})) for field in PATH._fields),
        *((PREVIEW, BEND._replace(**{field: nan})) for field in ("spacing_m", "k0_per_m")),
        (MISSION, Mission(True, False, 1, 61_000_000_000)),
    ],
)
def test_a_content_with_an_impossible_value_is_not_decoded(message, content):
    assert round_trip(message, content) is None


CENTIDEG = radians(0.01)
inputs = st.builds(ControlInput, *map(st.floats, INPUT_LIMITS.lower, INPUT_LIMITS.upper))
previews = st.builds(CurvaturePreview, st.floats(0.05, 65.5), *[st.floats(-0.16, 0.16)] * 5)
paths = st.builds(PathReference, *(st.floats(*range_) for range_ in REFERENCE.ranges))
states = st.builds(VehicleState, *(st.floats(*range_) for range_ in STATE.ranges[:6]))


@given(inputs, st.sampled_from(Mode), previews, paths, states)
def test_every_allowed_value_arrives_within_half_an_lsb(control, mode, preview, path, state):
    command = round_trip(COMMAND, Command(control, mode))
    assert command.mode is mode
    sample = round_trip(STATE, SAMPLE._replace(state=state))
    assert (sample[1:4], sample[4:]) == (pytest.approx(SAMPLE[1:4]), SAMPLE[4:])
    late = Heartbeat(mode, Fault(0), 5, 10**9, 10**10, 3)  # two times too long for the frame
    sent = late._replace(compute_time_ns=None, state_age_ns=None)
    assert round_trip(HEARTBEAT, late) == sent
    half_lsb = VehicleState(0.0025, 0.0005, 0.5e-4, 0.5e-4, 0.0005, 0.5e-4)
    for sent, received, tolerances in (
        (control, command.control, (1e-5, 0.00125, CENTIDEG)),
        (control, round_trip(FEEDBACK, control), (1e-5, 0.00125, CENTIDEG)),
        (preview, round_trip(PREVIEW, preview), (0.0005, *[2.5e-6] * 5)),
        (path, round_trip(REFERENCE, path), (0.0005, 1e-5, 5e-7, 1e-7, 0.001, 0.0005)),
        (state, sample.state, half_lsb),
    ):
        for value, found, tolerance in zip(sent, received, tolerances, strict=True):
            assert abs(value - found) <= 1.001 * tolerance


TRIAL_DBC = """
BO_ 2047 TRIAL: 8 VEHICLE
 SG_ Crc : 0|8@1+ (1,0) [0|255] "" CONTROLLER
 SG_ Counter : 8|4@1+ (1,0) [0|15] "" CONTROLLER
 SG_ Valid : 12|1@1+ (1,0) [0|1] "" CONTROLLER
 SG_ Cycle : 13|3@1+ (1,0) [0|7] "" CONTROLLER
 SG_ Voltage : 16|16@1+ (0.01,0) [0|600] "V" CONTROLLER
 SG_ Temperature : 32|8@1- (1,0) [-40|120] "degC" CONTROLLER

CM_ "The bus"""
TRIAL_ATTRIBUTES = """
BA_ "GenMsgCycleTime" BO_ 2047 250;
BA_ "E2EDataIdList" BO_ 2047 "00 01 02 03 04 05 06 07 08 09 0A 0B 0C 0D 0E 0F";

VAL_ 2047 Voltage 65535 "NotAvailable" ;
VAL_ 2047 Temperature -128 "NotAvailable" ;
VAL_ 256 Mode"""
TRIAL_FRAME = FrameSpec("TRIAL", "Valid", ("Voltage", "Temperature"))


@pytest.fixture
def catalogue(tmp_path: Path) -> Catalogue:
    text = DBC_PATH.read_text(encoding="ascii")
    path = tmp_path / "messages.dbc"
    path.write_text(
        text.replace('\nCM_ "The bus', TRIAL_DBC, 1).replace(
            "\nVAL_ 256 Mode", TRIAL_ATTRIBUTES, 1
        ),
        encoding="ascii",
    )
    return Catalogue(path)


def define_trial(catalogue: Catalogue) -> Message[tuple[float, float]]:
    return catalogue.define(
        TRIAL_FRAME,
        cycle_ticks=10,
        encode=lambda content: content,
        decode=lambda voltage_v, temperature_degc: (voltage_v, temperature_degc),
    )


def test_a_message_of_an_extended_dbc_is_sent_and_received(catalogue):
    trial = define_trial(catalogue)
    inbox = Inbox(Node.CONTROLLER, catalogue=catalogue)
    with open_bus("virtual", "trial") as near, open_bus("virtual", "trial") as far:
        outbox = Outbox(far, Node.VEHICLE, catalogue=catalogue)
        for now_ns in range(3):
            outbox.send(trial, (398.5, 21.0 + now_ns), now_ns)
        inbox.drain(near, 7)
    newest = inbox.newest(trial)
    assert newest.content == pytest.approx((398.5, 23.0))
    assert (newest.counter, newest.arrival_ns) == (2, 7)
    assert trial.sender is Node.VEHICLE
    assert trial.cycle_ms == 10 * PERIOD_MS
