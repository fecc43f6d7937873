"""The DBC is complete and agrees with the contract."""

from math import degrees
from pathlib import Path

import cantools
import pytest
from cantools.database.can import Message, Signal

from rt_controller.bus.codec import FrameCodec, FrameSpec
from rt_controller.bus.cycle_times import with_cycle_times
from rt_controller.bus.dbc import DBC_PATH, dbc_path, read_dbc
from rt_controller.bus.messages import CATALOGUE, COMMAND, REFERENCE
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.faults import Fault, Refusal
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import Mode

DATABASE = cantools.database.load_file(DBC_PATH, strict=True)
CODECS = [codec for message in CATALOGUE.messages for codec in message.codecs]
MESSAGES: list[Message] = DATABASE.messages
SIGNALS = [(message, signal) for message in MESSAGES for signal in message.signals]
BODY = [(message, signal) for message, signal in SIGNALS if signal.start >= 16]


def _name(value: object) -> str:
    return value.name if isinstance(value, Message | Signal) else str(value)


def test_the_program_defines_exactly_the_messages_of_the_dbc() -> None:
    defined = {(codec.name, codec.arbitration_id) for codec in CODECS}
    assert defined == {(message.name, message.frame_id) for message in MESSAGES}


@pytest.mark.parametrize("message", MESSAGES, ids=_name)
def test_every_message_has_comment_sender_receiver_and_protection(message: Message) -> None:
    assert message.comment, f"expected a comment: CM_ BO_ {message.frame_id}"
    assert message.length == 8
    assert not message.is_extended_frame
    assert len(message.senders) == 1
    assert message.receivers | set(message.senders) == {"CONTROLLER", "VEHICLE"}
    assert message.dbc is not None
    assert set(message.dbc.attributes) >= {"GenMsgCycleTime", "E2EDataIdList"}


@pytest.mark.parametrize(("message", "signal"), SIGNALS, ids=_name)
def test_every_signal_has_a_comment(message: Message, signal: Signal) -> None:
    assert signal.comment, f"expected a comment: CM_ SG_ {message.frame_id} {signal.name}"


@pytest.mark.parametrize(("message", "signal"), BODY, ids=_name)
def test_every_quantity_has_a_unit(message: Message, signal: Signal) -> None:
    is_coded = len(signal.choices or {}) > 1  # has other names than NotAvailable
    is_dimensionless = "dimensionless" in str(signal.comment).lower()
    assert [bool(signal.unit), is_coded, is_dimensionless].count(True) == 1, (
        f"{message.name}.{signal.name}: expected a unit, or names for its values (VAL_), or the "
        f"word Dimensionless in its comment (CM_), and only one of the three"
    )


@pytest.mark.parametrize(("message", "signal"), BODY, ids=_name)
def test_every_range_leaves_raw_values_that_are_never_valid(
    message: Message, signal: Signal
) -> None:
    codec = next(codec for codec in CODECS if codec.name == message.name)
    layout = next(layout for layout in codec.signals if layout.name == signal.name)
    lowest, highest = (
        (-(2 ** (signal.length - 1)), 2 ** (signal.length - 1) - 1)
        if signal.is_signed
        else (0, 2**signal.length - 1)
    )
    assert lowest <= layout.raw_min < layout.raw_max <= highest
    reserved = lowest if signal.is_signed else highest
    assert layout.raw_not_available == reserved, (
        f'expected VAL_ {message.frame_id} {signal.name} {reserved} "NotAvailable": the lowest raw '
        f"value of a signed signal, the highest of an unsigned one"
    )
    assert not layout.raw_min <= layout.raw_not_available <= layout.raw_max


def test_cycle_times_follow_from_the_control_period() -> None:
    """After a change of the period: python -m rt_controller.bus.cycle_times"""
    for definition in CATALOGUE.messages:
        for codec in definition.codecs:
            message = DATABASE.get_message_by_name(codec.name)
            assert message.cycle_time == definition.cycle_ms, codec.name


@pytest.mark.parametrize("is_fd", [False, True])
def test_cycle_times_in_the_dbc_are_replaced_by_those_of_the_period(is_fd: bool) -> None:
    text = dbc_path(is_fd).read_text(encoding="ascii")
    outdated = text.replace('"GenMsgCycleTime" BO_ 312 100;', '"GenMsgCycleTime" BO_ 312 7;')
    assert outdated != text
    assert with_cycle_times(outdated) == text


@pytest.mark.parametrize("name", ["ACT_CMD", "CTRL_HB"])
def test_modes_have_the_names_of_the_contract(name: str) -> None:
    signal = DATABASE.get_message_by_name(name).get_signal_by_name("Mode")
    assert {raw: str(text) for raw, text in signal.choices.items()} == {
        int(m): m.name for m in Mode
    }
    assert (signal.minimum, signal.maximum) == (min(Mode), max(Mode))


def test_every_fault_bit_has_its_name_in_the_value_table() -> None:
    faults = DATABASE.get_message_by_name("CTRL_HB").get_signal_by_name("Faults")
    names = {raw: str(text) for raw, text in faults.choices.items()}
    bits = {int(fault): fault.name for fault in Fault}
    assert names == {0: "NONE", **bits, 65535: "NotAvailable"}
    assert sum(bits) <= faults.maximum


def test_every_bit_of_the_vehicle_has_its_name_in_the_value_table() -> None:
    faults = DATABASE.get_message_by_name("STATE_C").get_signal_by_name("VehicleFaults")
    names = {raw: str(text) for raw, text in faults.choices.items()}
    bits = {int(refusal): refusal.name for refusal in Refusal}
    assert names == {0: "NONE", **bits, 255: "NotAvailable"}
    assert faults.maximum == sum(bits) - 1  # a command of two sources is not looked into


def test_the_command_has_the_highest_priority() -> None:
    assert min(message.frame_id for message in MESSAGES) == COMMAND.codecs[0].arbitration_id


def test_every_input_that_the_limits_allow_can_be_sent() -> None:
    for control in (INPUT_LIMITS.lower, INPUT_LIMITS.upper):
        values = (control.throttle, control.brake_n, degrees(control.steer_rad))
        for layout, value in zip(COMMAND.codecs[0].signals, values, strict=True):
            low, high = layout.raw_min * layout.scale, layout.raw_max * layout.scale
            assert low <= value <= high, layout.name


@pytest.mark.parametrize(("power", "name"), [(0, "C0"), (1, "C1"), (2, "C2"), (3, "C3")])
def test_rounding_a_path_coefficient_moves_the_path_by_less_than_2_mm_at_20_m(
    power: int, name: str
) -> None:
    layouts = [layout for codec in REFERENCE.codecs for layout in codec.signals]
    layout = next(layout for layout in layouts if layout.name == name)
    assert layout.scale / 2 * 20.0**power < 0.002


@pytest.mark.parametrize(
    ("name", "largest"), [("C0", 3.5), ("C1", 0.5), ("C2", 0.02), ("C3", 0.005)]
)
def test_a_lane_change_of_3_5_m_over_40_m_can_be_sent(name: str, largest: float) -> None:
    layouts = [layout for codec in REFERENCE.codecs for layout in codec.signals]
    layout = next(layout for layout in layouts if layout.name == name)
    assert layout.raw_min * layout.scale <= -largest
    assert layout.raw_max * layout.scale >= largest


@pytest.mark.parametrize(
    ("line", "replacement"),
    [
        (" Throttle ", " Pedal "),
        ("SG_ Crc : 0|8@1+", "SG_ Crc : 0|7@1+"),
        ("SG_ Throttle : 16|16@1+", "SG_ Throttle : 17|15@1+"),
        ("SG_ Throttle : 16|16@1+", "SG_ Throttle : 23|16@0+"),
        ("SG_ Throttle : 16|16@1+ (0.00002,0) [0|1]", "SG_ Throttle : 16|16@1+ (0.00002,0) [0|2]"),
        (
            "SG_ Throttle : 16|16@1+ (0.00002,0) [0|1]",
            "SG_ Throttle : 16|16@1+ (0.00002,0) [0|1.3107]",
        ),
        ('VAL_ 256 Throttle 65535 "NotAvailable"', 'VAL_ 256 Throttle 65535 "Broken"'),
        ('BA_ "E2EDataIdList" BO_ 256 "', 'BA_ "E2EDataIdList" BO_ 256 "00 '),
        ('BA_ "E2EDataIdList" BO_ 256 "', 'BA_ "E2EDataIdList" BO_ 256 "none'),
        ('BA_ "GenMsgCycleTime" BO_ 256 25;', ""),
        ("[-600|600]", "[0|0]"),
        ("BO_ 256 ACT_CMD: 8", "BO_ 256 ACT_CMD: 16"),
        ("BO_ 256 ACT_CMD", "BO_ 256 ACT"),
        ("BO_ 256 ACT_CMD", "BO_ 2147483904 ACT_CMD"),
        ("NS_ :", "NONSENSE"),
    ],
)
def test_a_dbc_that_the_codec_does_not_support_is_refused(
    tmp_path: Path, line: str, replacement: str
) -> None:
    text = DBC_PATH.read_text(encoding="ascii")
    assert line in text
    path = tmp_path / "messages.dbc"
    path.write_text(text.replace(line, replacement), encoding="ascii")
    with pytest.raises(ConfigError, match=r"(?s)expected .* found .*Restore"):
        FrameCodec(
            read_dbc(path),
            FrameSpec("ACT_CMD", "Mode", ("Throttle", "BrakeForce", "SteeringWheelAngle")),
        )


def test_the_frames_of_can_fd_have_the_signals_of_the_classic_ones() -> None:
    """Scaling, range, unit and names of values are those of messages.dbc."""
    fast = cantools.database.load_file(dbc_path(is_fd=True), strict=True)
    assert {message.name for message in fast.messages} == {
        codec.name for each in CATALOGUE.messages for codec in each.fd_codecs
    }
    for definition in CATALOGUE.messages:
        (codec,) = definition.fd_codecs
        message = fast.get_message_by_name(codec.name)
        assert message.frame_id == definition.codecs[0].arbitration_id
        assert message.cycle_time == definition.cycle_ms
        assert message.senders == [definition.sender]
        assert message.is_fd
        assert message.comment
        assert all(signal.comment for signal in message.signals)
        for classic in definition.codecs:
            for signal in DATABASE.get_message_by_name(classic.name).signals:
                if signal.name in ("Crc", "Counter", "Cycle"):
                    continue
                other = message.get_signal_by_name(signal.name)
                for name in ("scale", "offset", "minimum", "maximum", "unit", "is_signed"):
                    assert getattr(other, name) == getattr(signal, name), signal.name
                assert (other.choices or {}) == (signal.choices or {}), signal.name


@pytest.mark.parametrize(
    ("line", "replacement"),
    [
        ('BA_ "E2EDataId" BO_ 256 256;', ""),
        ("SG_ Crc : 0|16@1+", "SG_ Crc : 0|8@1+"),
        ("SG_ Counter : 16|8@1+", "SG_ Counter : 16|4@1+"),
        (" Throttle ", " Pedal "),
    ],
)
def test_a_dbc_of_can_fd_that_the_codec_does_not_support_is_refused(
    tmp_path: Path, line: str, replacement: str
) -> None:
    text = dbc_path(is_fd=True).read_text(encoding="ascii")
    assert line in text
    path = tmp_path / "messages_fd.dbc"
    path.write_text(text.replace(line, replacement), encoding="ascii")
    with pytest.raises(ConfigError, match=r"(?s)expected .* found .*Restore"):
        FrameCodec(
            read_dbc(path),
            FrameSpec("ACT_CMD", "Mode", ("Throttle", "BrakeForce", "SteeringWheelAngle")),
        )


def test_a_missing_catalogue_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="expected the message catalogue"):
        read_dbc(tmp_path / "messages.dbc")
