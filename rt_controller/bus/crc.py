"""The checksum of end-to-end protection: CRC-8 with polynomial 0x2F.

AUTOSAR calls it CRC8H2F and uses it in profiles 2 and 22. In an eight-byte frame it detects every
error of up to three bits outside the counter. The data id, one byte that never travels, depends
on message and counter: a whole frame under the id of another message fails the check. The ids in
the DBC are chosen so that every error of one or two bits anywhere is detected as well.
"""

from collections.abc import Sequence

_POLYNOMIAL = 0x2F
_ALL_ONES = 0xFF


def _remainder(byte: int) -> int:
    for _ in range(8):
        byte = (byte << 1) ^ (_POLYNOMIAL if byte & 0x80 else 0)
    return byte & 0xFF


_TABLE = tuple(_remainder(byte) for byte in range(256))


def crc8_h2f(data: Sequence[int]) -> int:
    """CRC-8/H2F of all bytes: start and final value all ones, no reflection."""
    table = _TABLE
    crc = _ALL_ONES
    for byte in data:
        crc = table[crc ^ byte]
    return crc ^ _ALL_ONES


def frame_crc(frame: bytes | bytearray, data_id: int) -> int:
    """What byte 0 of a frame must be: the CRC of its other bytes and of the data id."""
    t = _TABLE
    _, a, b, c, d, e, f, g = frame  # written out: a loop would take twice as long
    return t[t[t[t[t[t[t[t[_ALL_ONES ^ a] ^ b] ^ c] ^ d] ^ e] ^ f] ^ g] ^ data_id] ^ _ALL_ONES
