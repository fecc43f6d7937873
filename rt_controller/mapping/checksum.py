"""Checksums of a car's own messages: one function, whose parameters are `Checksum` of the mapping.

Where a checksum is, and what its value is.
"""

from collections.abc import Iterator
from functools import reduce
from operator import xor
from typing import NamedTuple

from cantools.database.can import Signal

from rt_controller.contract.crc8 import crc8_table
from rt_controller.contract.errors import ConfigError
from rt_controller.mapping.tables import CHECKSUM_LIMIT, Checksum

_AUTOSAR = {"crc8_0x1d": 0x1D, "crc8_0x2f": 0x2F}
"""polynomials of AUTOSAR's CRC library; start and final value are 0xFF"""


class Place(NamedTuple):
    """Bits of a frame, within one byte."""

    byte: int
    shift: int
    mask: int
    """of the value"""

    def read(self, data: bytes) -> int:
        """The value that a frame has."""
        return data[self.byte] >> self.shift & self.mask

    def write(self, data: bytearray, value: int) -> None:
        """Replace the value."""
        data[self.byte] = data[self.byte] & ~(self.mask << self.shift) | value << self.shift


def place_of(where: str, checksum: Checksum, signal: Signal) -> Place:
    """The bits of a checksum.

    Raises:
        ConfigError: they are in several bytes, or not as many as its kind has.
    """
    shift = signal.start % 8
    if signal.byte_order == "big_endian":  # the start is the most significant bit
        shift -= signal.length - 1
    if signal.length != checksum.bits or not 0 <= shift <= 8 - signal.length:
        raise ConfigError(
            f"{where}: expected a signal of {checksum.bits} bits in one byte for {checksum.kind}, "
            f"found {signal.name} at bit {signal.start} with {signal.length} bits; "
            f"{CHECKSUM_LIMIT}. Leave the checksum out; the frame is then used unchecked."
        )
    return Place(signal.start // 8, shift, (1 << signal.length) - 1)


def checksum_of(
    settings: Checksum, place: Place, identifier: int, data: bytes | bytearray, counter: int
) -> int:
    """The value that a frame must have in `place`, over all bits but those of `place`.

    Args:
        settings: kind and parameters.
        place: of the checksum.
        identifier: of the frame.
        data: of the frame, with any value in `place`.
        counter: of the frame; it selects one of `data_ids`.
    """
    covered = bytearray(data)
    place.write(covered, 0)
    if settings.bits == 8:
        del covered[place.byte]
    hidden = list(settings.data_id)
    if settings.data_ids:
        hidden.append(settings.data_ids[counter % len(settings.data_ids)])
    if settings.identifier:
        hidden += identifier.to_bytes(4, "big")
    if settings.length:
        hidden.append(len(data))
    whole = bytes((*hidden, *covered) if settings.data_id_first else (*covered, *hidden))
    if settings.kind.startswith("crc8"):
        polynomial = _AUTOSAR.get(settings.kind)
        if polynomial is not None:
            return _crc8(polynomial, 0xFF, whole) ^ 0xFF
        return _crc8(settings.polynomial or 0, settings.start, whole) ^ settings.final_xor
    digits = whole if settings.bits == 8 else bytes(_nibbles(whole))
    if settings.kind.startswith("xor"):
        return reduce(xor, digits, 0)
    total = sum(digits)
    return (total if settings.complement is None else settings.complement - total) & place.mask


def _nibbles(data: bytes) -> Iterator[int]:
    for byte in data:
        yield from divmod(byte, 16)


def _crc8(polynomial: int, start: int, data: bytes) -> int:
    """Not reflected."""
    table = crc8_table(polynomial)
    return reduce(lambda crc, byte: table[crc ^ byte], data, start)
