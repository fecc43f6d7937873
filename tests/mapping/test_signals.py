"""What is written in a car's own messages is read back; an independent decoder agrees."""

from math import degrees, isnan, pi

import can
import cantools
import crccheck
import pytest
from own_car import (
    EXAMPLE,
    VALUES,
    changed,
    command_reader,
    command_writer,
    example,
    state_reader,
    state_writer,
)

from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.contract.signals import VEHICLE
from rt_controller.mapping.can_log import read_frames
from rt_controller.mapping.car_file import find_source, load_dbc, read_car
from rt_controller.mapping.signal_frames import SignalReader, SignalWriter
from rt_controller.mapping.slots import Slot, slots_of
from rt_controller.mapping.tables import ColumnMapping, SwitchMapping

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


DBC = """VERSION ""
BU_: CAR PC
BO_ 16 Status: 8 CAR
 SG_ State : 0|3@1+ (1,0) [0|7] "" PC
 SG_ Heading : 8|16@1+ (0.01,0) [0|359.99] "deg" PC
 SG_ Pressure : 24|12@1+ (0.1,0) [0|250] "bar" PC
 SG_ Pedal : 40|8@1+ (0.5,0) [0|100] "" PC
VAL_ 16 State 0 "Off" 1 "Ready" 2 "Active" 6 "Fault" 7 "SNA" ;
"""
ANY = (float("-inf"), float("inf"))
PRESSURE = ColumnMapping(column="Pressure", unit="bar")


def both_ways(slot, value):
    """What is read of a value that was written."""
    database = cantools.database.load_string(DBC, "dbc")
    (frame,) = SignalWriter([slot], {}, database, "car").frames({slot.name: value}, 0)
    found = SignalReader([slot], {}, database, "car").read(frame)[slot.name]
    return database.decode_message(16, bytes(frame.data), decode_choices=False), found


def test_a_message_of_can_fd_is_sent_and_read_as_such(tmp_path):
    (tmp_path / "car.dbc").write_text(
        DBC.replace("BO_ 16 Status: 8", "BO_ 16 Status: 16")
        + 'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","StandardCAN_FD";\n'
        + 'BA_DEF_DEF_ "VFrameFormat" "StandardCAN";\nBA_ "VFrameFormat" BO_ 16 1;\n'
    )
    database, (slot,) = load_dbc(tmp_path / "car.dbc"), slots_of("signals", [("p", PRESSURE)])
    (frame,) = SignalWriter([slot], {}, database, "car").frames({slot.name: 2e5}, 0)
    assert (database.is_fd, frame.is_fd, len(frame.data)) == (True, True, 16)
    assert SignalReader([slot], {}, database, "car").read(frame) == pytest.approx({slot.name: 2e5})
    assert not example().database.is_fd


def switch(*on, off=None):
    column = SwitchMapping(column="State", on=on)
    off = None if off is None else frozenset(off)
    return Slot("mission.engage", column, "1", ANY, on=frozenset(on), off=off)


@pytest.mark.parametrize(
    ("on", "off", "values"),
    [  # of the raw values 0 to 7; the DBC names 0, 1, 2, 6 "Fault" and 7 "SNA"
        ((2, 3), None, [0.0, 0.0, 1.0, 1.0, None, None, None, None]),
        ((1,), None, [0.0, 1.0, 0.0, *[None] * 5]),
        ((0,), None, [1.0, 0.0, 0.0, *[None] * 5]),
        ((1,), (0, 6), [0.0, 1.0, None, None, None, None, 0.0, None]),  # so does `off`
        ((7,), None, [0.0, 0.0, 0.0, *[None] * 4, 1.0]),  # `on` wins over the name of the value
        ((1,), (0, 4), [0.0, 1.0, None, None, 0.0, None, None, None]),
    ],
)
def test_a_switch_is_known_at_its_values_only(on, off, values):
    database = cantools.database.load_string(DBC, "dbc")
    reader = SignalReader([switch(*on, off=off)], {}, database, "car")
    for raw, expected in enumerate(values):
        (frame,) = SignalWriter([switch(raw)], {}, database, "car").frames(
            {"mission.engage": 1.0}, 0
        )
        value = reader.read(frame)["mission.engage"]
        assert isnan(value) if expected is None else value == expected


@pytest.mark.parametrize(("on", "off"), [((2, 3), 0), ((0,), 1)])
def test_a_simulated_car_sends_a_switch_with_its_values(on, off):
    assert both_ways(switch(*on), 1.0)[0]["State"] == min(on)
    assert both_ways(switch(*on), 0.0)[0]["State"] == off


@pytest.mark.parametrize("yaw_rad", [-3.0, 0.0, 2.1, 7.0])
def test_a_compass_heading_is_sent_in_the_range_of_its_signal(yaw_rad):
    """Clockwise from north, 0 to 360 deg."""
    column = ColumnMapping(column="Heading", unit="deg", sign=-1, offset=-90.0)
    sent, found = both_ways(Slot("pose.yaw", column, "rad", ANY), yaw_rad)
    assert sent["Heading"] == pytest.approx((90.0 - yaw_rad * 180.0 / pi) % 360.0, abs=0.006)
    assert (found - yaw_rad + 0.1) % (2.0 * pi) == pytest.approx(0.1, abs=1e-4)


@pytest.mark.parametrize(
    ("column", "si", "value", "raw"),
    [
        ({"column": "Pressure", "unit": "N", "factor": 3.0}, "N", 60.0, 20.0),
        ({"column": "Pedal", "unit": "%"}, "1", 0.25, 25.0),  # without a unit in the DBC
    ],
)
def test_a_value_is_converted_by_unit_and_factor(column, si, value, raw):
    sent, found = both_ways(Slot("commands.any", ColumnMapping(**column), si, ANY), value)
    assert sent[column["column"]] == pytest.approx(raw)
    assert found == pytest.approx(value)


@pytest.mark.parametrize(
    ("unit", "factor", "si", "hint"),
    [("N", 1.0, "N", "factor that converts bar to N"), ("kPa", 2.0, "Pa", "Correct the unit")],
)
def test_another_unit_than_that_of_the_dbc_is_refused(unit, factor, si, hint):
    column = ColumnMapping(column="Pressure", unit=unit, factor=factor)
    with pytest.raises(DatasetError, match=hint):
        both_ways(Slot("commands.brake_n", column, si, ANY), 1.0)


def test_the_example_is_a_mapping_of_offline_import_too():
    log_mapping = pytest.importorskip("offline.logs.mapping")
    mapping, _ = log_mapping.read_mapping(EXAMPLE)
    assert mapping.state_names == VEHICLE.state_names
    assert mapping.places_roads is False


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("vx_mps = {", "vy_mps = {", r"states: expected vx_mps, yaw_rate_radps"),
        ("[messages.", "[mesages.", r"mesages: no such setting \(did you mean messages\?\)"),
        ("[mission]", "[split]", r"mission: expected a value, found none\. .*docs/own-car"),
        ('reference_line = "line.csv"\n', "", "expected the place on the road"),
        (
            *('"VehicleSpeed", unit = "km/h"', '"VehicleSpeed", unit = "deg/s"'),
            r"vx_mps: expected a unit that is converted to m/s",
        ),
        (
            *("[messages.WheelSpeed]", "[messages.WheelSped]"),
            r"messages of car\.dbc, found WheelSped",
        ),
        ("WheelSpeed: 8", "WheelSpeed: 1", r"messages\.WheelSpeed: expected a message that can be"),
    ],
)
def test_a_mapping_for_driving_is_refused_with_what_is_missing(tmp_path, old, new, message):
    with pytest.raises(ConfigError, match=message):
        changed(tmp_path, (old, new))
    with pytest.raises(ConfigError, match=r".*none\.toml: expected a mapping file"):
        read_car(tmp_path / "none.toml")


INERTIAL = 'BO_ 291 Inertial: 8 CAR\n SG_ YawRate : 7|16@0- (0.01,0) [-300|300] "°/s" CAR\n'
RADIO = 'BO_ 900 Radio: 8 CAR\n SG_ Volume : 0|8@1+ (1,0) [0|100] "" CAR\n'
MEANING = """
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 1000;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_ "GenMsgCycleTime" BO_ 291 20;
SIG_VALTYPE_ 900 Volume : 0;
VAL_ 291 YawRate -32768 "SNA" ;
"""


@pytest.mark.parametrize("encoding", ["cp1252", "latin-1", "utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_a_unit_is_read_in_any_encoding_of_a_dbc(tmp_path, encoding, ending):
    path = tmp_path / "car.dbc"
    text = f'VERSION ""\nBU_: CAR\n{INERTIAL}'.replace("\n", ending)
    path.write_bytes(text.encode(encoding))
    assert find_source("here", load_dbc(path), "YawRate").signal.unit == "°/s"


SELECTED = """ SG_ Volume M : 0|8@1+ (1,0) [0|100] "" CAR
 SG_ Level m0 : 8|8@1+ (1,0) [0|100] "" CAR
 SG_ Level m1 : 8|16@1+ (1,0) [0|100] "" CAR
"""
VOLUME = ' SG_ Volume : 0|8@1+ (1,0) [0|100] "" CAR\n'


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (VOLUME, f'{VOLUME} SG_ Station : 4|8@1+ (1,0) [0|1] "" CAR\n', "are overlapping"),
        ("BO_ 900", "BO_ 71303219", "more than 11 bits"),
        ("0|8@1+", "60|8@1+", "does not fit in message"),
        ("Radio: 8", "Radio: eight", "syntax error at >>!<<"),
        (" Radio: 8", " 2_Radio: 8", "syntax error at >>!<<"),
        ("(1,0) [0|100]", "(.5,0) [0|100]", "syntax error at >>!<<"),
        (VOLUME, f"BUMPS_ 3\n{VOLUME}", "syntax error at >>!<<"),
        (VOLUME, SELECTED, "several signals Level"),
        (RADIO, RADIO + RADIO.replace("900", "901"), "several messages of this name"),
        (RADIO, f'{RADIO}\nVAL_ 900 Volume 0 "off" 1 on ;\n', "syntax error at >>!<<"),
    ],
)
def test_a_defect_of_a_message_is_its_own(tmp_path, old, new, reason):
    path = tmp_path / "car.dbc"
    text = f'VERSION ""\nBU_: CAR\n{INERTIAL}\n{RADIO}\nVAL_ 900 Volume 255 "error" ;{MEANING}'
    assert old in text
    path.write_text(text.replace(old, new), "cp1252")
    database = load_dbc(path)
    name = "2_Radio" if "2_Radio" in new else "Radio"
    assert database.note.startswith(f"car.dbc: 1 of 2 messages cannot be read (first: {name}: ")
    assert database.note.endswith("; they are not mapped")
    message, signal = find_source("here", database, "YawRate")
    assert message.cycle_time == 20
    assert str(signal.choices[-32768]) == "SNA"
    for column in ("Volume", f"{name}.Volume", f"{name}.Other"):
        with pytest.raises(ConfigError) as refused:
            find_source("here", database, column)
        assert f"found {name}: " in str(refused.value)
        assert reason in str(refused.value)


@pytest.mark.parametrize(
    "defect",
    [
        'VAL_ 291 Missing 0 "off" 1 "on" ;',
        'VAL_ 292 YawRate 0 "off" 1 "on" ;',
        "SIG_VALTYPE_ 291 Missing : 1;",
        'CM_ SG_ 291 "no signal";',
        'CM_ BO_ 291 "a "word" in quotes";',
        'CM_ BO_ 291 "has no end;',
        'CM_ BO_ 291 "lines\nBO_ 900 Radio: 8 CAR\n SG_ YawRate : 0|9@1+ (1,0) [0|1] \\"\\" CAR";x',
        'BA_ "NeverDefined" BO_ 291 3;',
        'BA_DEF_ BO_ "GenMsgSendType" ENUM ;\nBA_ "GenMsgSendType" BO_ 291 7;',
        "EV_ Door: 0 [0|1] 0 DUMMY;",
        "SIG_GROUP_ 291 Group : YawRate;",
        "NEW_STATEMENT_ 291 3;",
        "BU_: CAR ; CAR",
        "VERSION 3",
        'BA_DEF_ SG_ "GenSigStartValue" STRING ;\nBA_ "GenSigStartValue" SG_ 291 YawRate "x";',
    ],
)
def test_a_defect_beside_the_messages_is_none_of_theirs(tmp_path, defect):
    path = tmp_path / "car.dbc"
    path.write_text(f"BU_: CAR\n{INERTIAL}\n{defect}\n\n{RADIO}{MEANING}", "cp1252")
    database = load_dbc(path)
    assert database.note == ""
    assert {message.name for message in database.messages} == {"Inertial", "Radio"}
    message, signal = find_source("here", database, "Inertial.YawRate")
    assert (signal.length, str(signal.choices[-32768])) == (16, "SNA")
    assert message.cycle_time == (None if "StartValue" in defect else 20)


@pytest.mark.parametrize(
    ("line", "number"),
    [
        ("(1.000000) can0 123#", 1),
        ("(1.000000) can0 00000123#0102 R", 1),
        ("(1.000000) can0 123##10102", 1),
        ("(1.000000) can0 123#R8", 0),  # a remote frame has no data
        ("(1.000000) can0 20000004#0000000000000000", 0),  # an error frame
    ],
)
def test_lines_of_candump_are_read(tmp_path, line, number):
    (tmp_path / "a.log").write_text(f"{line}\n")
    found = list(read_frames(tmp_path / "a.log", "Copy it."))
    assert [(each.number, each.channel) for each in found] == [(1, "can0")] * number


@pytest.mark.parametrize(
    "line", ["(17", "(1.0) can0", "(x) can0 123#00", "(1.0) can0 123#ZZ", "(1.0) can0 123#012"]
)
def test_a_damaged_line_of_candump_is_named_with_its_number(tmp_path, line):
    log = tmp_path / "a.log"
    log.write_text(f"(1.0) can0 123#00\n\n{line}\n")
    expected = r"(seconds) channel ID#DATA with ID and DATA in hexadecimal digits"
    with pytest.raises(DatasetError) as refused:
        list(read_frames(log, "Copy it."))
    assert str(refused.value) == f"{log}, line 3: expected {expected}, found {line!r}. Copy it."


DAMAGES = {
    "another hexadecimal digit": (".asc", lambda b: b.replace(b" 02\n", b" ZZ\n"), "frame 3: exp"),
    "no last line": (".asc", lambda b: b.replace(b"End TriggerBlock\n", b""), "End TriggerBlock"),
    "relative": (".asc", lambda b: b.replace(b"absolute", b"relative"), "since the beginning"),
    "cut": (".blf", lambda b: b[:-9], "truncated"),
    "text": (".blf", lambda _: b"text", "in the format of its suffix"),
    "a line without its end": (".log", lambda b: b[:-1], "a complete last line"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_log_is_refused_in_words_of_its_format(tmp_path, damage):
    suffix, change, message = DAMAGES[damage]
    log = tmp_path / f"a{suffix}"
    with can.Logger(log) as writer:
        for number in range(3):
            writer(can.Message(timestamp=number, data=[number]))
    log.write_bytes(change(log.read_bytes()))
    with pytest.raises(DatasetError, match=message):
        list(read_frames(log, "Copy it."))


@pytest.mark.parametrize("suffix", [".asc", ".blf", ".trc"])
def test_channels_are_those_of_the_file(tmp_path, suffix):
    """python-can counts from 0 what ASC and BLF files, and Vector's tools, count from 1."""
    log = tmp_path / f"a{suffix}"
    with can.Logger(log) as writer:
        for channel in (0, 1):
            writer(can.Message(timestamp=channel, data=[1], channel=channel))
    text = log.read_bytes().decode("latin-1")
    found = [each.channel for each in read_frames(log, "Copy it.")]
    assert found == ["1", "2"]
    if suffix == ".asc":
        written = [line.split()[1] for line in text.splitlines() if " d 1 " in line]
        assert written == found
