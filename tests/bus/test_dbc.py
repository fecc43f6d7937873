"""The DBC is complete, agrees with the contract, and is the one of the peer."""

import hashlib

import cantools
import pytest
from cantools.database.can import Message

from rt_controller.bus.codec import SignalLayout
from rt_controller.bus.dbc import DBC_PATH
from rt_controller.bus.identity import (
    dbc_hash,
    hash_of_catalogue,
    leading_digits,
    model_hash,
)
from rt_controller.bus.messages import CATALOGUE
from rt_controller.contract.faults import Fault, Refusal
from rt_controller.contract.signals import Mode

DATABASE = cantools.database.load_file(DBC_PATH, strict=True)
CODECS = [codec for message in CATALOGUE.messages for codec in message.codecs]
MESSAGES: list[Message] = DATABASE.messages


def layout_of(message: str, signal: str) -> SignalLayout:
    codec = next(codec for codec in CODECS if codec.name == message)
    return next(layout for layout in codec.signals if layout.name == signal)


def test_every_quantity_has_a_unit_and_a_raw_value_that_is_never_valid():
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
def test_modes_and_bits_have_the_names_of_the_contract(message, signal, values, largest):
    found = DATABASE.get_message_by_name(message).get_signal_by_name(signal)
    names = {raw: str(text) for raw, text in found.choices.items() if text != "NotAvailable"}
    assert names == {int(each): each.name or "NONE" for each in values}
    assert (found.minimum, found.maximum) == (0, largest)


TEXT = DBC_PATH.read_text(encoding="ascii")


def test_the_hash_is_that_of_the_text_without_line_ends_and_trailing_blanks():
    """So that any other program can compute it; it changes with any scale."""
    digest = hashlib.sha256(b"A\n B\n").hexdigest()
    assert f"{hash_of_catalogue('A  ' + chr(10) * 2 + ' B'):08x}" == digest[:8]
    for equal in (TEXT, TEXT.replace("\n", "\r\n"), TEXT.replace("\n", "  \n\n") + "\n\n"):
        assert hash_of_catalogue(equal) == dbc_hash()
    other = TEXT.replace("(0.005,0)", "(0.0050001,0)")
    assert hash_of_catalogue(other) != dbc_hash()


def test_hashes_never_have_the_value_of_not_available():
    assert model_hash("ffff0") == 0xFFFE
    assert model_hash("fffe0") == 0xFFFE
    assert model_hash("00010") == 1
    assert leading_digits("f" * 64, 8) == 0xFFFF_FFFE


def test_the_program_has_the_messages_of_the_dbc_with_their_signals_in_order_and_period():
    defined = {(codec.name, codec.arbitration_id) for codec in CODECS}
    assert defined == {(message.name, message.frame_id) for message in MESSAGES}
    for definition in CATALOGUE.messages:
        for codec in definition.codecs:
            message: Message = DATABASE.get_message_by_name(codec.name)
            signals = sorted(message.signals, key=lambda signal: signal.start)
            names = [signal.name for signal in signals if signal.start >= 16]
            assert names == [layout.name for layout in codec.signals]
            assert message.senders == [definition.sender]
            assert message.cycle_time == definition.cycle_ms
