"""The checksum against published values, two independent implementations and bit errors."""

from itertools import combinations

import pytest
from cantools.autosar.end_to_end import compute_profile2_crc
from crccheck.crc import Crc8Autosar
from hypothesis import given, settings
from hypothesis import strategies as st

from rt_controller.bus.codec import FrameCodec, crc8
from rt_controller.bus.messages import CATALOGUE, COMMAND

COUNTER_BITS = range(8, 12)
REMEDY = "new data ids: python -m rt_controller.bus.data_ids"
CODECS = [codec for message in CATALOGUE.messages for codec in message.codecs]


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        ("313233343536373839", 0xDF),
        ("00000000", 0x12),
        ("F20183", 0xC2),
        ("0FAA0055", 0xC6),
        ("00FF5511", 0x77),
        ("332255AABBCCDDEEFF", 0x11),
        ("926B55", 0x33),
        ("FFFFFFFF", 0x6C),
    ],
)
def test_the_reference_has_the_published_check_values(data: str, expected: int) -> None:
    """The values in AUTOSAR's specification of CRC routines."""
    assert Crc8Autosar.calc(bytes.fromhex(data)) == expected


@settings(derandomize=True, deadline=None)
@given(st.binary(min_size=8, max_size=8), st.integers(0, 255))
def test_crc8_agrees_with_crccheck_and_with_profile_2_of_cantools(
    frame: bytes, data_id: int
) -> None:
    assert crc8(frame, data_id) == Crc8Autosar.calc(frame[1:] + bytes([data_id]))
    assert crc8(frame, data_id) == compute_profile2_crc(frame, data_id)


def _flipped(frame: bytes, bits: tuple[int, ...]) -> bytes:
    word = int.from_bytes(frame, "little")
    for bit in bits:
        word ^= 1 << bit
    return word.to_bytes(8, "little")


@pytest.mark.parametrize("codec", CODECS, ids=lambda codec: codec.name)
def test_every_error_of_one_or_two_bits_is_detected(codec: FrameCodec) -> None:
    """Also in the counter, where an error also selects another data id."""
    for counter in range(16):
        frame = codec.encode([1.0] * len(codec.signals), counter, 1)
        for n_bits in (1, 2):
            for bits in combinations(range(64), n_bits):
                assert not (codec.check(_flipped(frame, bits)) >= 0), (counter, bits, REMEDY)


def test_every_error_of_three_bits_outside_the_counter_is_detected() -> None:
    frame = COMMAND.codecs[0].encode((0.25, 10.0, -3.0), 5, 1)
    bits_outside = [bit for bit in range(64) if bit not in COUNTER_BITS]
    undetected = [
        bits
        for bits in combinations(bits_outside, 3)
        if (COMMAND.codecs[0].check(_flipped(frame, bits)) >= 0)
    ]
    assert undetected == []


def test_an_intact_frame_under_the_id_of_another_message_is_refused() -> None:
    """For every counter no two messages share a data id."""
    for counter in range(16):
        ids = [codec.data_ids[counter] for codec in CODECS]
        assert len(set(ids)) == len(CODECS), (counter, REMEDY)


@pytest.mark.parametrize("byte", [b"\x00", b"\xff"])
def test_a_frame_of_equal_bytes_is_never_intact(byte: bytes) -> None:
    """As a line without signal or an erased memory would give."""
    assert not any((codec.check(byte * 8) >= 0) for codec in CODECS)
