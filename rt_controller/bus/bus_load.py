"""How much of the time frames occupy a CAN bus: bits with the stuffing that they need."""

from collections.abc import Iterable
from itertools import groupby

from can.util import len2dlc

from rt_controller.contract.timing import PERIOD_S

CyclicFrame = tuple[int, bytes | bytearray, int]
"""identifier, data, and cycle in control periods"""
CLASSIC_BITRATE = 500_000
_POLYNOMIAL = 0x4599
_UNSTUFFED_BITS = 13
"""delimiter of the CRC, acknowledgement with its delimiter, end of frame, space between frames"""
_LONGEST_CRC_17 = 16
"""bytes; longer frames of CAN FD have a CRC of 21 bits"""
_STUFF_COUNT_BITS = 4
_FIXED_RUN = 4
"""bits of the CRC of CAN FD, before and after which a bit is stuffed whatever they are"""
_RUN = 5
"""equal bits in a row, after which the opposite one is stuffed"""


def frame_bits(identifier: int, data: bytes | bytearray) -> int:
    """Bits on the wire of a classic frame with an 11-bit identifier, space after it included.

    Source: ISO 11898-1, data frame in base format.
    """
    bits = _bits(((0, 1), (identifier, 11), (0, 3), (len(data), 4)), data)
    crc = 0
    for bit in bits:
        crc = (crc << 1 & 0x7FFF) ^ (_POLYNOMIAL if bit ^ crc >> 14 else 0)
    bits += [crc >> place & 1 for place in reversed(range(15))]
    return len(bits) + _stuffed(bits) + _UNSTUFFED_BITS


def fd_frame_bits(identifier: int, data: bytes | bytearray) -> int:
    """The same of a frame of CAN FD that does not switch the bit rate.

    Source: ISO 11898-1, data frame in FD base format.
    """
    format_bits = 0b00100  # RRS, IDE, FDF, reserved, BRS; then ESI
    head = ((0, 1), (identifier, 11), (format_bits, 5), (0, 1), (len2dlc(len(data)), 4))
    bits = _bits(head, data)
    crc_bits = _STUFF_COUNT_BITS + (17 if len(data) <= _LONGEST_CRC_17 else 21)
    crc_bits += 1 + crc_bits // _FIXED_RUN
    # After the last bit of the data follows a fixed stuff bit.
    return len(bits) + _stuffed(bits[:-1]) + crc_bits + _UNSTUFFED_BITS


def bus_load(frames: Iterable[CyclicFrame], bitrate: int, is_fd: bool = False) -> float:
    """Share of the time, 0 to 1, that cyclic frames occupy the bus.

    Args:
        frames: one of each identifier.
        bitrate: in bit/s.
        is_fd: they are frames of CAN FD.
    """
    count = fd_frame_bits if is_fd else frame_bits
    per_period = sum(count(number, data) / cycle for number, data, cycle in frames)
    return per_period / (PERIOD_S * bitrate)


def _bits(head: Iterable[tuple[int, int]], data: bytes | bytearray) -> list[int]:
    """The bits of numbers of a given length, and of the data, in the order of sending."""
    fields = (*head, *((byte, 8) for byte in data))
    return [number >> place & 1 for number, length in fields for place in reversed(range(length))]


def _stuffed(bits: list[int]) -> int:
    """Number of stuffed bits: one after five equal ones, itself the first of the next run."""
    stuffed, carried, value = 0, 0, -1
    for bit, group in groupby(bits):
        length = sum(1 for _ in group) + (carried if bit == value else 0)
        carried = 0
        while length >= _RUN:
            stuffed += 1
            length -= _RUN
            value, carried = 1 - bit, 1
            if length:  # the stuffed bit ended the run, which begins again
                carried = 0
    return stuffed
