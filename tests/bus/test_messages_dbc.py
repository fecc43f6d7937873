"""The DBC is complete and agrees with the contract."""

from collections.abc import Iterable
from math import degrees
from pathlib import Path

import cantools
import pytest
from cantools.database.can import Message

from rt_controller.bus.codec import FrameCodec, FrameSpec, SignalLayout
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


def layout_of(message: str, signal: str) -> SignalLayout:
    codec = next(codec for codec in CODECS if codec.name == message)
    return next(layout for layout in codec.signals if layout.name == signal)


def test_the_program_defines_exactly_the_messages_of_the_dbc() -> None:
    defined = {(codec.name, codec.arbitration_id) for codec in CODECS}
    assert defined == {(message.name, message.frame_id) for message in MESSAGES}


@pytest.mark.parametrize("is_fd", [False, True])
def test_cycle_times_in_the_dbc_are_replaced_by_those_of_the_period(is_fd: bool) -> None:
    text = dbc_path(is_fd).read_text(encoding="ascii")
    outdated = text.replace('"GenMsgCycleTime" BO_ 312 100;', '"GenMsgCycleTime" BO_ 312 7;')
    assert outdated != text
    assert with_cycle_times(outdated) == text


def test_every_message_has_comment_sender_receiver_and_protection() -> None:
    for message in MESSAGES:
        assert message.comment, f"expected a comment: CM_ BO_ {message.frame_id}"
        assert (message.length, message.is_extended_frame, len(message.senders)) == (8, False, 1)
        assert message.receivers | set(message.senders) == {"CONTROLLER", "VEHICLE"}
        assert message.dbc is not None
        assert set(message.dbc.attributes) >= {"GenMsgCycleTime", "E2EDataIdList"}
        for signal in message.signals:
            assert signal.comment, f"expected: CM_ SG_ {message.frame_id} {signal.name}"


def test_every_quantity_has_a_unit_and_a_raw_value_that_is_never_valid() -> None:
    for message in MESSAGES:
        for signal in message.signals:
            if signal.start < 16:
                continue
            is_coded = len(signal.choices or {}) > 1  # has other names than NotAvailable
            is_dimensionless = "dimensionless" in str(signal.comment).lower()
            assert [bool(signal.unit), is_coded, is_dimensionless].count(True) == 1, (
                f"{message.name}.{signal.name}: expected a unit, or names for its values (VAL_), "
                f"or the word Dimensionless in its comment (CM_), and only one of the three"
            )
            n_low, n_high = (signal.length - 1,) * 2 if signal.is_signed else (0, signal.length)
            lowest, highest = (-(2**n_low) if signal.is_signed else 0), 2**n_high - 1
            layout = layout_of(message.name, signal.name)
            assert lowest <= layout.raw_min < layout.raw_max <= highest
            reserved = lowest if signal.is_signed else highest
            assert layout.raw_not_available == reserved, (
                f'expected VAL_ {message.frame_id} {signal.name} {reserved} "NotAvailable": the '
                f"lowest raw value of a signed signal, the highest of an unsigned one"
            )
            assert not layout.raw_min <= reserved <= layout.raw_max


@pytest.mark.parametrize(
    ("message", "signal", "values", "largest"),
    [
        ("ACT_CMD", "Mode", Mode, max(Mode)),
        ("CTRL_HB", "Mode", Mode, max(Mode)),
        ("CTRL_HB", "Faults", (Fault(0), *Fault), 65534),
        # A command of two sources is not looked into.
        ("STATE_C", "VehicleFaults", (Refusal(0), *Refusal), sum(Refusal) - 1),
    ],
)
def test_modes_and_bits_have_the_names_of_the_contract(
    message: str, signal: str, values: Iterable[Mode | Fault | Refusal], largest: int
) -> None:
    found = DATABASE.get_message_by_name(message).get_signal_by_name(signal)
    names = {raw: str(text) for raw, text in found.choices.items() if text != "NotAvailable"}
    assert names == {int(each): each.name or "NONE" for each in values}
    assert (found.minimum, found.maximum) == (0, largest)


def test_the_command_has_the_highest_priority() -> None:
    assert min(message.frame_id for message in MESSAGES) == COMMAND.codecs[0].arbitration_id


def test_every_input_that_the_limits_allow_can_be_sent() -> None:
    for control in (INPUT_LIMITS.lower, INPUT_LIMITS.upper):
        values = (control.throttle, control.brake_n, degrees(control.steer_rad))
        for layout, value in zip(COMMAND.codecs[0].signals, values, strict=True):
            low, high = layout.raw_min * layout.scale, layout.raw_max * layout.scale
            assert low <= value <= high, layout.name


@pytest.mark.parametrize(
    ("name", "largest"), [("C0", 3.5), ("C1", 0.5), ("C2", 0.02), ("C3", 0.005)]
)
def test_a_lane_change_of_3_5_m_over_40_m_can_be_sent(name: str, largest: float) -> None:
    layouts = [layout for codec in REFERENCE.codecs for layout in codec.signals]
    layout = next(layout for layout in layouts if layout.name == name)
    assert layout.raw_min * layout.scale <= -largest
    assert layout.raw_max * layout.scale >= largest


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
    ("is_fd", "line", "replacement"),
    [
        (False, " Throttle ", " Pedal "),
        (False, "SG_ Crc : 0|8@1+", "SG_ Crc : 0|7@1+"),
        (False, "SG_ Throttle : 16|16@1+", "SG_ Throttle : 17|15@1+"),
        (False, "SG_ Throttle : 16|16@1+", "SG_ Throttle : 23|16@0+"),
        (False, "(0.00002,0) [0|1]", "(0.00002,0) [0|2]"),
        (False, "(0.00002,0) [0|1]", "(0.00002,0) [0|1.3107]"),
        (False, 'VAL_ 256 Throttle 65535 "NotAvailable"', 'VAL_ 256 Throttle 65535 "Broken"'),
        (False, 'BA_ "E2EDataIdList" BO_ 256 "', 'BA_ "E2EDataIdList" BO_ 256 "00 '),
        (False, 'BA_ "E2EDataIdList" BO_ 256 "', 'BA_ "E2EDataIdList" BO_ 256 "none'),
        (False, 'BA_ "GenMsgCycleTime" BO_ 256 25;', ""),
        (False, "[-600|600]", "[0|0]"),
        (False, "BO_ 256 ACT_CMD: 8", "BO_ 256 ACT_CMD: 16"),
        (False, "BO_ 256 ACT_CMD", "BO_ 256 ACT"),
        (False, "BO_ 256 ACT_CMD", "BO_ 2147483904 ACT_CMD"),
        (False, "NS_ :", "NONSENSE"),
        (True, 'BA_ "E2EDataId" BO_ 256 256;', ""),
        (True, "SG_ Crc : 0|16@1+", "SG_ Crc : 0|8@1+"),
        (True, "SG_ Counter : 16|8@1+", "SG_ Counter : 16|4@1+"),
        (True, " Throttle ", " Pedal "),
    ],
)
def test_a_dbc_that_the_codec_does_not_support_is_refused(
    tmp_path: Path, is_fd: bool, line: str, replacement: str
) -> None:
    text = dbc_path(is_fd).read_text(encoding="ascii")
    assert line in text
    path = tmp_path / "messages.dbc"
    path.write_text(text.replace(line, replacement), encoding="ascii")
    spec = FrameSpec("ACT_CMD", "Mode", ("Throttle", "BrakeForce", "SteeringWheelAngle"))
    with pytest.raises(ConfigError, match=r"(?s)expected .* found .*Restore"):
        FrameCodec(read_dbc(path), spec)


def test_a_missing_catalogue_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="expected the message catalogue"):
        read_dbc(tmp_path / "messages.dbc")
