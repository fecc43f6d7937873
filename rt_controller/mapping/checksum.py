"""Checksums of a car's own messages: eight bits over all other bytes of the frame."""

from collections.abc import Callable
from functools import reduce
from operator import xor

from rt_controller.mapping.car_signals import Checksum, ChecksumKind


def _crc8_table(polynomial: int) -> tuple[int, ...]:
    def remainder(byte: int) -> int:
        for _ in range(8):
            byte = (byte << 1) ^ (polynomial if byte & 0x80 else 0)
        return byte & 0xFF

    return tuple(remainder(byte) for byte in range(256))


def _crc8(polynomial: int) -> Callable[[bytes], int]:
    table = _crc8_table(polynomial)
    return lambda data: reduce(lambda crc, byte: table[crc ^ byte], data, 0xFF) ^ 0xFF


_KINDS: dict[ChecksumKind, Callable[[bytes], int]] = {
    "crc8_0x1d": _crc8(0x1D),
    "crc8_0x2f": _crc8(0x2F),
    "xor8": lambda data: reduce(xor, data, 0),
    "sum8": lambda data: sum(data) & 0xFF,
}
"""both CRCs: start and final value 0xFF, not reflected, as in AUTOSAR's CRC library"""


def checksum_of(settings: Checksum, data: bytes | bytearray, place: int) -> int:
    """The checksum of a frame, whose own byte is at `place` and does not count."""
    others = bytes(data[:place]) + bytes(data[place + 1 :]) + bytes(settings.data_id)
    return _KINDS[settings.kind](others)
