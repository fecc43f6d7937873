"""Checksums of eight bits, of the own messages and of a car's: the table of a polynomial."""

from functools import cache


@cache
def crc8_table(polynomial: int) -> bytes:
    """For each byte the CRC-8 of it, not reflected, with start and final value 0.

    With this table, the remainder `crc` goes on with a byte as `table[crc ^ byte]`.
    """

    def shifted(byte: int) -> int:
        for _ in range(8):
            byte = (byte << 1) ^ (polynomial if byte & 0x80 else 0)
        return byte & 0xFF

    return bytes(map(shifted, range(256)))
