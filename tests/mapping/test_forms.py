"""Common forms of a car's messages: numbers of several signals, checksums, source addresses."""

from math import nan

import can
import cantools
import pytest
from crccheck import crc
from own_car import changed
from pydantic import TypeAdapter

from rt_controller.contract.car import UNNAMED_CAR
from rt_controller.contract.errors import ConfigError
from rt_controller.gateway.command_check import require_sendable
from rt_controller.mapping.signal_frames import SignalReader, SignalWriter
from rt_controller.mapping.slots import slots_of
from rt_controller.mapping.tables import ColumnMapping, MessageMapping, SignalMapping, SwitchMapping
from rt_controller.mapping.toml_file import parse

DBC = """VERSION ""
BU_: CAR PC
BO_ 16 Wheel: 8 CAR
 SG_ Magnitude : 7|15@0+ (0.01,0) [0|163.82] "deg" PC
 SG_ Sign : 8|2@0+ (1,0) [0|1] "" PC
 SG_ Coarse : 19|12@0- (1.5,0) [-500|500] "deg" PC
 SG_ Fraction : 39|4@0- (0.1,0) [-0.7|0.7] "deg" PC
 SG_ Steps : 40|8@1+ (2,-20) [0|0] "deg" PC
 SG_ Rest : 48|5@1+ (0.1,0) [0|2.5] "deg" PC
 SG_ Minutes : 56|6@1+ (0.001,0) [0|0] "rad" PC
BO_ 17 Other: 8 CAR
 SG_ Page M : 0|1@1+ (1,0) [0|1] "" PC
 SG_ First m0 : 8|8@1+ (1,0) [0|0] "deg" PC
 SG_ Second m1 : 8|8@1+ (1,0) [0|0] "deg" PC
VAL_ 16 Sign 3 "SNA" ;
VAL_ 16 Fraction -8 "SNA" ;
"""


def both_ways(value_deg, **column):
    """A value through a writer, an independent decoder, and a reader."""
    database = cantools.database.load_string(DBC, "dbc")
    (slot,) = slots_of("states", [("angle_rad", SignalMapping(unit="deg", **column))])
    value = value_deg * 3.141592653589793 / 180.0
    (frame,) = SignalWriter([slot], {}, database, "car").frames({slot.name: value}, 0)
    sent = database.decode_message(frame.arbitration_id, frame.data, decode_choices=False)
    found = SignalReader([slot], {}, database, "car").read(frame)[slot.name]
    return sent, found * 180.0 / 3.141592653589793


SIGNED = {"column": "Magnitude", "negative": {"column": "Sign"}}
FINE = {"column": "Wheel.Coarse", "fine": "Wheel.Fraction"}
UNSIGNED_FINE = {"column": "Steps", "fine": "Rest"}
BOTH = {"column": "Steps", "fine": "Rest", "negative": "Sign"}


@pytest.mark.parametrize(
    ("column", "value_deg", "expected_deg"),
    [
        (SIGNED, -12.34, -12.34),
        (SIGNED, 12.34, 12.34),
        (SIGNED, -200.0, -163.82),
        (FINE, -0.74, -0.7),
        (FINE, 333.21, 333.2),
        (FINE, -333.29, -333.3),
        (FINE, 501.0, 500.2),
        (UNSIGNED_FINE, -3.14, -3.1),
        (UNSIGNED_FINE, 0.0, 0.0),
        (UNSIGNED_FINE, 600.0, 492.5),
        (BOTH, -7.77, -7.8),
        ({**SIGNED, "sign": -1}, -12.34, -12.34),
    ],
)
def test_a_number_of_several_signals_is_sent_and_read(column, value_deg, expected_deg):
    sent, found = both_ways(value_deg, **column)
    parts = [str(column[name]).rpartition(".")[2] for name in ("column", "fine") if name in column]
    number = sum(sent[name] for name in parts)
    if "negative" in column:
        number *= -1 if sent["Sign"] else 1
    assert found == pytest.approx(expected_deg, abs=1e-6)
    assert number == pytest.approx(column.get("sign", 1) * expected_deg, abs=1e-6)


@pytest.mark.parametrize(
    ("column", "raws", "expected_deg"),
    [
        (SIGNED, {"Magnitude": 100, "Sign": 1}, -1.0),
        (SIGNED, {"Magnitude": 100, "Sign": 3}, nan),
        (SIGNED, {"Magnitude": 0x7FFF, "Sign": 0}, nan),
        ({**SIGNED, "plausible": (-7.0, 7.0)}, {"Magnitude": 0x7FFF, "Sign": 1}, -327.67),
        ({**SIGNED, "plausible": (-1.0, 7.0)}, {"Magnitude": 0x7FFF, "Sign": 1}, nan),
        (FINE, {"Coarse": 10, "Fraction": -7}, 14.3),
        (FINE, {"Coarse": 10, "Fraction": -8}, nan),
        (FINE, {"Coarse": 1000, "Fraction": 0}, nan),
        (BOTH, {"Steps": 12, "Rest": 26, "Sign": 1}, nan),
        (BOTH, {"Steps": 12, "Rest": 25, "Sign": 1}, -6.5),
    ],
)
def test_there_is_no_measurement_if_a_part_is_none(column, raws, expected_deg):
    database = cantools.database.load_string(DBC, "dbc")
    wheel = database.get_message_by_name("Wheel")
    start = dict.fromkeys((signal.name for signal in wheel.signals), 0)
    data = wheel.encode({**start, **raws}, scaling=False, strict=False)
    (slot,) = slots_of("states", [("angle_rad", SignalMapping(unit="deg", **column))])
    reader = SignalReader([slot], {}, database, "car")
    found = reader.read(can.Message(arbitration_id=16, is_extended_id=False, data=data))
    expected = pytest.approx(expected_deg * 3.141592653589793 / 180.0, nan_ok=True)
    assert found == {"states.angle_rad": expected}


@pytest.mark.parametrize(
    ("column", "message"),
    [
        ({"column": "Steps", "fine": "First"}, r"angle_rad\.fine: expected a signal of Wheel \("),
        ({"column": "Steps", "fine": "Minutes"}, "a number in deg as that of Steps, found rad"),
        ({"column": "First", "fine": "Second"}, "in the frames that have First"),
    ],
)
def test_parts_are_in_the_same_frames_and_units(column, message):
    with pytest.raises(ConfigError, match=message):
        both_ways(0.0, **column)


def test_a_switch_has_one_signal():
    with pytest.raises(ConfigError, match="a switch of one signal"):
        SwitchMapping(column="Steps", negative="Sign")


def test_parts_are_refused_in_a_log_that_is_a_table(tmp_path):
    source = pytest.importorskip("offline.logs.readers.source")
    mapping = parse(
        '[states]\nvx_mps = { column = "v", unit = "m/s", negative = "s" }\n'
        '[inputs]\nthrottle = { column = "p", unit = "1" }\n[time]\nperiod_s = 0.1\n',
        TypeAdapter(source.LogMapping),
        "car.toml",
    )
    (tmp_path / "a.csv").write_text("v,s,p\n1,0,0\n2,1,0\n")
    with pytest.raises(source.DatasetError, match=r"signals\.vx_mps in one column.*CAN logs only"):
        source.read_log(source.DriveFiles("a.csv", tmp_path / "a.csv"), mapping)


# Checksums

FRAMES = """VERSION ""
BU_: CAR PC
BO_ 228 Short: 5 CAR
 SG_ Value : 7|16@0+ (1,0) [0|65535] "" PC
 SG_ Count : 37|2@0+ (1,0) [0|3] "" PC
 SG_ Nibble : 35|4@0+ (1,0) [0|15] "" PC
 SG_ Wide : 16|16@1+ (1,0) [0|65535] "" PC
BO_ 740 Long: 8 CAR
 SG_ Number : 8|16@1+ (1,0) [0|65535] "" PC
 SG_ Counter : 24|4@1+ (1,0) [0|15] "" PC
 SG_ First : 0|8@1+ (1,0) [0|255] "" PC
 SG_ Last : 63|8@0+ (1,0) [0|255] "" PC
 SG_ Middle : 50|4@1+ (1,0) [0|15] "" PC
 SG_ Across : 38|4@1+ (1,0) [0|15] "" PC
BO_ 2566844926 Extended: 5 CAR
 SG_ Torque : 7|16@0+ (1,0) [0|65535] "" PC
 SG_ Turn : 37|2@0+ (1,0) [0|3] "" PC
 SG_ Digit : 35|4@0+ (1,0) [0|15] "" PC
"""
IDS = [37 * k % 256 for k in range(16)]


def protected(column, **checksum):
    """A writer and a reader of one signal, and its slot's name."""
    database = cantools.database.load_string(FRAMES, "dbc")
    message = next(m for m in database.messages if any(s.name == column for s in m.signals))
    counter = next(s.name for s in message.signals if s.name in ("Count", "Counter", "Turn"))
    settings = MessageMapping.model_validate(
        {"counter": counter, "checksum": checksum, "driving": {}, "standby": {}}
    )
    (slot,) = slots_of("signals", [("a", ColumnMapping(column=column, unit="1"))])
    of = {message.name: settings}
    return SignalWriter([slot], of, database, "car"), SignalReader([slot], of, database, "car")


def require_read_and_damage_noticed(reader, frames):
    for frame in frames:
        for bit in range(8 * len(frame.data)):
            damaged = bytearray(frame.data)
            damaged[bit // 8] ^= 1 << bit % 8
            number, is_extended = frame.arbitration_id, frame.is_extended_id
            other = can.Message(arbitration_id=number, is_extended_id=is_extended, data=damaged)
            assert reader.read(other) is None, bit
        assert reader.read(frame) is not None


@pytest.mark.parametrize(
    ("column", "checksum", "expected"),
    [
        # Honda: 8 - (0 + E + 4) - (1 + 2 + 3 + 4) - (counter nibble 0, 1) = -20, -21
        (
            "Value",
            {"signal": "Nibble", "kind": "sum4", "identifier": True, "complement": 8},
            ["123400000c", "123400001b"],
        ),
        # with 29 bits 8 + 3; identifier 18FEF1FE: 1+8+F+E+F+1+F+E = 83; 11 - 83 - 10 = -82
        (
            "Torque",
            {"signal": "Digit", "kind": "sum4", "identifier": True, "complement": 11},
            ["123400000e", "123400001d"],
        ),
        # Toyota: 2 + E4 + length 8 + 34 + 12 + counter = 134, 135
        (
            "Number",
            {"signal": "Last", "kind": "sum8", "identifier": True, "length": True},
            ["0034120000000034", "0034120100000035"],
        ),
        # 3 ^ 4 ^ 1 ^ 2 = 4; in bits 2 to 5 of byte 6
        ("Number", {"signal": "Middle", "kind": "xor4"}, ["0034120000001000", "0034120100001400"]),
        # 255 - (34 + 12 + counter + A5)
        (
            "Number",
            {"signal": "First", "kind": "sum8", "complement": 255, "data_id": [0xA5]},
            ["1434120000000000", "1334120100000000"],
        ),
        (
            "Number",
            {"signal": "First", "kind": "xor8", "data_id": [0x0F]},
            ["2934120000000000", "2834120100000000"],
        ),
    ],
)
def test_sums_are_those_computed_by_hand(column, checksum, expected):
    writer, reader = protected(column, **checksum)
    frames = [frame for k in (0, 1) for frame in writer.frames({"signals.a": 0x1234}, k)]
    assert [bytes(frame.data).hex() for frame in frames] == expected
    require_read_and_damage_noticed(reader, frames)


def crc8(polynomial, start=0, final_xor=0):
    return {"kind": "crc8", "polynomial": polynomial, "start": start, "final_xor": final_xor}


@pytest.mark.parametrize(
    ("checksum", "oracle", "covered"),
    [
        ({"kind": "crc8_0x1d"}, crc.Crc8SaeJ1850, lambda data, _: data),
        ({"kind": "crc8_0x2f", "data_id": [0xA5, 1]}, crc.Crc8Autosar, lambda d, _: d + b"\xa5\1"),
        (
            {"kind": "crc8_0x2f", "data_ids": IDS},  # as VW does
            crc.Crc8Autosar,
            lambda data, counter: data + bytes([IDS[counter]]),
        ),
        (
            {**crc8(0x1D), "data_id": [3, 4], "data_id_first": True},  # AUTOSAR's profile 1
            crc.Crc8GsmA,
            lambda data, _: b"\3\4" + data,
        ),
        (crc8(0x07), crc.Crc8, lambda data, _: data),
        (crc8(0x07, final_xor=0x55), crc.Crc8Itu, lambda data, _: data),
        (crc8(0x1D, 0xFD), crc.Crc8ICode, lambda data, _: data),
        (crc8(0x31, 0xFF), crc.Crc8Nrsc5, lambda data, _: data),
    ],
)
@pytest.mark.parametrize(("signal", "place"), [("First", 0), ("Last", 7)])
def test_crcs_are_those_of_an_independent_library(checksum, oracle, covered, signal, place):
    writer, reader = protected("Number", signal=signal, **checksum)
    frames = [frame for k in range(18) for frame in writer.frames({"signals.a": 999.0 * k}, k)]
    for k, frame in enumerate(frames):
        data = bytes(frame.data)
        assert data[place] == oracle.calc(covered(data[:place] + data[place + 1 :], k % 16))
    require_read_and_damage_noticed(reader, frames[:3])


@pytest.mark.parametrize(
    ("checksum", "message"),
    [
        ({"signal": "Wide", "kind": "crc16"}, "checksums of 4 or 8 bits"),
        ({"signal": "Wide", "kind": "sum8"}, "8 bits in one byte.*with 16 bits; checksums of 4 or"),
        ({"signal": "Nibble", "kind": "sum8"}, "expected a signal of 8 bits"),
        ({"signal": "Across", "kind": "sum4"}, "4 bits in one byte.*Leave the checksum out"),
        ({"signal": "Nibble", "kind": "crc8"}, "expected a polynomial"),
        ({"signal": "Nibble", "kind": "xor4", "complement": 8}, "of xor4.*found complement"),
        ({"signal": "Nibble", "kind": "sum4", "data_ids": [1]}, "at least 16 items"),
    ],
)
def test_other_checksums_are_refused_with_the_limit(checksum, message):
    column = "Number" if checksum["signal"] == "Across" else "Value"
    with pytest.raises((ConfigError, ValueError), match=message):
        protected(column, **checksum)


def test_a_list_of_data_ids_needs_a_counter():
    checksum = {"signal": "First", "kind": "crc8_0x2f", "data_ids": IDS}
    with pytest.raises(ValueError, match="expected a counter"):
        MessageMapping.model_validate({"checksum": checksum})


# Source addresses


def j1939(source, column="Torque"):
    database = cantools.database.load_string(FRAMES, "dbc")
    counter = "Turn" if column == "Torque" else "Count"
    of = {"Extended": MessageMapping(source=source, counter=counter)}
    of["Short"] = MessageMapping(source=source if column == "Value" else None)
    (slot,) = slots_of("signals", [("a", ColumnMapping(column=column, unit="1"))])
    return SignalReader([slot], of, database, "car"), SignalWriter([slot], of, database, "car")


def sent_by(address, count):
    data = bytes([0, address, 0, 0, count << 4])
    return can.Message(arbitration_id=0x18FEF100 | address, is_extended_id=True, data=data)


@pytest.mark.parametrize(
    ("source", "read", "sent"), [(None, [0xFE], 0xFE), ("any", [0x00], 0xFE), (0x17, [0x17], 0x17)]
)
def test_frames_of_the_named_source_addresses_are_read(source, read, sent):
    reader, writer = j1939(source)
    found = [a for a in (0x00, 0x17, 0xFE) if reader.read(sent_by(a, 0)) == {"signals.a": a}]
    assert found == read
    assert writer.frames({"signals.a": 1.0}, 0)[0].arbitration_id == 0x18FEF100 | sent
    assert not reader.has(can.Message(arbitration_id=0x18FEF217, is_extended_id=True))


def test_the_first_of_several_sources_is_read_and_all_are_named():
    reader, _ = j1939("any")
    for count in range(8):
        assert reader.read(sent_by(0x17, count % 4)) is not None
    assert reader.objection("signals.a") == ("", "")
    for count in range(8):
        assert reader.read(sent_by(0x17, count % 4)) is not None
        assert reader.read(sent_by(0x03, (count + 1) % 4)) is None
    counts = reader.counts["Extended"]
    assert (counts.accepted, counts.repeated, counts.lost) == (16, 0, 0)
    assert "Extended from 2 source addresses (0x03, 0x17)" in reader.objection("signals.a")[0]


def test_a_message_with_11_bits_has_no_source():
    with pytest.raises(ConfigError, match=r"Short\.source: expected a message with a 29-bit"):
        j1939("any", "Value")


# Commands

WHEEL = (
    ' SG_ WheelRequestRight m1 : 24|16@1- (0.02,0) [-600|600] "deg" CAR\n',
    'column = "WheelRequestRight", unit = "deg", sign = -1',
)
UNSIGNED = "A m1 : 24|15@1+ (0.02,0) [0|600]"


@pytest.mark.parametrize(
    ("signals", "column", "message"),
    [
        ("A m1 : 24|15@1+ (0.02,0) [0|600];B m1 : 39|1@1+ (1,0) [0|1]", 'negative = "B"', None),
        ("A m1 : 24|15@1+ (0.02,0) [0|30];B m1 : 39|1@1+ (1,0) [0|1]", 'negative = "B"', "-30 to"),
        ("A m1 : 24|8@1- (2,0) [-39.3|39.3];B m1 : 32|4@1- (0.1,0) [0|0]", 'fine = "B"', None),
        ("A m1 : 24|8@1- (2,0) [-30|30];B m1 : 32|4@1- (0.1,0) [0|0]", 'fine = "B"', "-30.8 to"),
        (UNSIGNED, 'negative = "RequestEnable"', "one task for RequestEnable"),
        (UNSIGNED, 'negative = "RequestPage"', "one task for RequestPage"),
        (UNSIGNED, 'fine = "RequestChecksum"', "one task for RequestChecksum"),
    ],
)
def test_commands_of_several_signals_have_the_whole_range_and_places_of_their_own(
    tmp_path, signals, column, message
):
    own = "".join(f' SG_ {each} "deg" CAR\n' for each in signals.split(";"))
    mapped = f'column = "A", unit = "deg", sign = -1, {column}'
    car = changed(tmp_path, (WHEEL[0], own), (WHEEL[1], mapped))
    if message is None:
        require_sendable(car, UNNAMED_CAR)
    else:
        with pytest.raises(ConfigError, match=message):
            require_sendable(car, UNNAMED_CAR)
