"""What is written in a car's own messages is read back; an independent decoder agrees."""

from math import degrees, isnan

import can
import crccheck
import pytest
from own_car import (
    VALUES,
    command_reader,
    command_writer,
    example,
    state_reader,
    state_writer,
)

CONTROL = {
    "commands.throttle": 0.25,
    "commands.brake_n": 30.0,
    "commands.steer_rad": 0.3,
    "commands.mode": 1.0,
}


def decoded(frames):
    """The physical values as cantools decodes them, by signal."""
    database = example().database
    found = {}
    for frame in frames:
        message = database.get_message_by_frame_id(frame.arbitration_id)
        found |= message.decode(bytes(frame.data), decode_choices=False)
    return found


def test_every_signal_of_the_car_is_read_back_in_si():
    car = example()
    reader, found = state_reader(car), {}
    for frame in state_writer(car).frames(VALUES, 0):
        found |= reader.read(frame)
    assert found == pytest.approx(VALUES, rel=2e-3, abs=1e-4)


def test_units_signs_pages_and_identifiers_are_those_of_the_dbc():
    frames = state_writer(example()).frames(VALUES, 0)
    found = decoded(frames)
    assert found["VehicleSpeed"] == pytest.approx(72.0)
    assert found["YawRateRight"] == pytest.approx(-degrees(0.02), abs=0.005)
    assert found["WheelAngleRight"] == pytest.approx(-degrees(0.1), abs=0.02)
    assert found["Offset"] == pytest.approx(50.0)
    localisation = [frame for frame in frames if frame.arbitration_id == 0x18FF0600]
    assert [frame.data[0] & 0xF for frame in localisation] == [0, 1, 2]
    assert all(frame.is_extended_id for frame in localisation)


def test_messages_are_sent_with_the_periods_of_the_dbc():
    writer = state_writer(example())
    sent = [{frame.arbitration_id for frame in writer.frames(VALUES, k)} for k in range(4)]
    assert [0x123 in ids for ids in sent] == [True] * 4
    assert [0x321 in ids for ids in sent] == [True, False, True, False]
    assert [0x322 in ids for ids in sent] == [True, False, False, False]


def test_a_command_is_two_pages_with_the_enable_bit_counter_and_checksum():
    writer, reader = command_writer(example()), command_reader(example())
    driving, standby = writer.frames(CONTROL, 0, True), writer.frames(CONTROL, 1, False)
    assert [frame.data[1] for frame in (*driving, *standby)] == [0, 1, 2, 3]
    for frame in driving:
        others = bytes([*frame.data[:2], *frame.data[3:], 0xA5])
        assert frame.data[2] == crccheck.crc.Crc8Autosar.calc(others)
    found = {}
    for frame in driving:
        found |= reader.read(frame)
    assert found == pytest.approx({**CONTROL, "driving": 1.0}, abs=1e-3)
    assert reader.read(standby[0])["driving"] == 0.0


def test_a_command_beyond_the_range_of_its_signal_is_sent_at_the_limit():
    writer = command_writer(example())
    found = decoded(writer.frames({**CONTROL, "commands.brake_n": 900.0}, 0))
    assert found["BrakeRequest"] == pytest.approx(500.0)


def test_a_value_that_is_not_known_is_not_sent():
    frames = state_writer(example()).frames({**VALUES, "states.vx_mps": float("nan")}, 0)
    assert 0x123 not in {frame.arbitration_id for frame in frames}


@pytest.fixture
def speed_frames():
    """Two frames of the speed, which has counter and checksum."""
    writer = state_writer(example())
    return [writer.frames(VALUES, k)[0] for k in range(2)]


def test_a_damaged_and_a_repeated_frame_are_dropped(speed_frames):
    reader = state_reader(example())
    first, second = speed_frames
    assert reader.read(first) is not None
    assert reader.read(first) is None
    damaged = can.Message(arbitration_id=0x123, is_extended_id=False, data=bytes(second.data))
    damaged.data[0] ^= 1
    assert reader.read(damaged) is None
    assert reader.read(second) is not None
    counts = reader.counts["WheelSpeed"]
    assert (counts.accepted, counts.repeated, counts.wrong_checksum) == (2, 1, 1)


def test_a_frame_that_is_too_short_or_of_the_other_kind_of_identifier_is_dropped(speed_frames):
    reader = state_reader(example())
    short = can.Message(arbitration_id=0x123, is_extended_id=False, data=b"\0\0\0")
    other = can.Message(arbitration_id=0x123, is_extended_id=True, data=speed_frames[0].data)
    assert reader.read(short) is None
    assert reader.read(other) is None
    assert reader.counts["WheelSpeed"].wrong_length == 1


@pytest.mark.parametrize(("raw", "is_used"), [(60000, True), (65535, False)])
def test_a_value_outside_the_range_of_the_dbc_is_none(raw, is_used):
    car = example()
    message = car.database.get_message_by_name("SpeedWish")
    data = message.encode({"Speed": raw, "Acceleration": 0}, scaling=False, strict=False)
    frame = can.Message(arbitration_id=0x321, is_extended_id=False, data=data)
    found = state_reader(car).read(frame)["reference.v_mps"]
    assert isnan(found) is not is_used
