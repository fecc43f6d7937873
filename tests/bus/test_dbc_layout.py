"""The DBC has no layout but those that the codec supports.

Imports no codec, which a DBC with another layout would break.
"""

import cantools
import pytest

from rt_controller.bus.dbc import DBC_PATH, data_ids_of

DATABASE = cantools.database.load_file(DBC_PATH, strict=True)


@pytest.mark.parametrize("message", DATABASE.messages, ids=lambda message: message.name)
def test_a_frame_has_the_head_of_profile_22_and_integers_of_whole_bytes(message):
    signals = sorted(message.signals, key=lambda signal: signal.start)
    has_valid = any(signal.name == "Valid" for signal in signals)
    flags = [("Valid", 12, 1), ("Cycle", 13, 3)] if has_valid else [("Mode", 12, 4)]
    head = [("Crc", 0, 8), ("Counter", 8, 4), *flags]
    assert [(each.name, each.start, each.length) for each in signals[: len(head)]] == head
    for signal in signals[len(head) :]:
        assert signal.start % 8 == 0, signal.name
        assert signal.length in (8, 16, 32), signal.name
        assert (signal.byte_order, signal.is_float) == ("little_endian", False), signal.name
        names = [str(name) for name in (signal.choices or {}).values()]
        assert names.count("NotAvailable") == 1, signal.name
    assert all(None not in (signal.minimum, signal.maximum) for signal in signals)


@pytest.mark.parametrize("message", DATABASE.messages, ids=lambda message: message.name)
def test_a_message_is_a_classic_frame_with_comments_receiver_and_protection(message):
    assert all((message.comment, *(signal.comment for signal in message.signals)))
    assert (message.length, message.is_extended_frame, message.is_fd) == (8, False, False)
    assert len(message.senders) == 1
    assert message.receivers | set(message.senders) == {"CONTROLLER", "VEHICLE"}
    assert message.cycle_time
    assert len(data_ids_of(message)) == 16
