"""The protection of CAN FD against independent implementations, bit errors and other frames."""

from itertools import combinations
from random import Random

import pytest
from cantools.autosar.end_to_end import compute_profile5_crc
from crccheck.crc import Crc16Autosar

from rt_controller.bus.codec import FrameCodec, crc16
from rt_controller.bus.messages import CATALOGUE, COMMAND, STATE

CODECS = [codec for message in CATALOGUE.messages for codec in message.fd_codecs]
RANDOM_ERRORS = 2_000


def flipped(frame: bytes, bits: tuple[int, ...]) -> bytes:
    word = int.from_bytes(frame, "little")
    for bit in bits:
        word ^= 1 << bit
    return word.to_bytes(len(frame), "little")


def test_the_reference_has_the_published_check_value() -> None:
    """Of CRC-16/CCITT-FALSE, in AUTOSAR's specification of CRC routines."""
    assert Crc16Autosar.calc(b"123456789") == 0x29B1


@pytest.mark.parametrize("codec", CODECS, ids=lambda codec: codec.name)
def test_the_crc_agrees_with_profile_5_of_cantools_and_with_crccheck(codec: FrameCodec) -> None:
    rng = Random(codec.name)
    for _ in range(200):
        frame, data_id = rng.randbytes(codec.length), rng.randrange(1 << 16)
        found = crc16(frame, data_id)
        assert found == compute_profile5_crc(frame, data_id)
        assert found == Crc16Autosar.calc(frame[2:] + data_id.to_bytes(2, "little"))
    sent = codec.encode([1.0] * len(codec.signals), 77, 1)
    expected = compute_profile5_crc(sent, codec.data_id)
    assert sent[:2] == expected.to_bytes(2, "little")


def test_every_error_of_one_two_or_three_bits_of_a_command_is_detected() -> None:
    (codec,) = COMMAND.fd_codecs
    frame = codec.encode((0.25, 10.0, -3.0), 200, 1)
    for n_bits in (1, 2, 3):
        for bits in combinations(range(8 * codec.length), n_bits):
            assert not (codec.check(flipped(frame, bits)) >= 0), bits


@pytest.mark.parametrize("codec", CODECS, ids=lambda codec: codec.name)
def test_every_error_of_one_or_two_bits_and_every_burst_of_16_is_detected(
    codec: FrameCodec,
) -> None:
    n_bits = 8 * codec.length
    frame = codec.encode([1.0] * len(codec.signals), 255, 1)
    pairs = [*combinations(range(n_bits), 1), *combinations(range(n_bits), 2)]
    assert not any((codec.check(flipped(frame, bits)) >= 0) for bits in pairs)
    rng = Random(codec.name)
    for _ in range(RANDOM_ERRORS):
        first = rng.randrange(16, n_bits - 16)  # of the bytes behind the CRC
        burst = rng.getrandbits(16) | 1
        bits = tuple(first + place for place in range(16) if burst >> place & 1)
        assert not (codec.check(flipped(frame, bits)) >= 0), bits


@pytest.mark.parametrize("codec", CODECS, ids=lambda codec: codec.name)
def test_a_frame_of_equal_bytes_or_of_another_length_is_not_intact(codec: FrameCodec) -> None:
    for byte in (b"\x00", b"\xff"):
        assert not (codec.check(byte * codec.length) >= 0)
    frame = codec.encode([1.0] * len(codec.signals), 3, 1)
    assert not (codec.check(frame[:-1]) >= 0)
    assert not (codec.check(frame + b"\x00") >= 0)


def test_an_intact_frame_under_the_id_of_another_message_is_refused() -> None:
    for codec in CODECS:
        frame = codec.encode([1.0] * len(codec.signals), 9, 1)
        others = [other for other in CODECS if other is not codec]
        assert codec.check(frame) >= 0
        assert not any((other.check(frame) >= 0) for other in others)


def test_a_state_has_the_bytes_computed_by_hand() -> None:
    """20 m/s / 0.005 = 4000 = 0x0FA0; -0.1 rad/s / 1e-4 = -1000; sample time 25 ms / 0.1 = 250."""
    (codec,) = STATE.fd_codecs
    values = (20.0, 0.5, -0.1, 0.5, 0.25, 0.01, 0.001, 25.0, 6.0, 1.0)
    frame = codec.write(values, 256 + 200)
    assert frame[2:] == bytes.fromhex("C8 01 A00F F401 18FC 8813 FA00 6400 C800 FA00 06 01 0000")
    assert codec.read(frame) == pytest.approx(values)
    assert codec.check(frame) == 200
