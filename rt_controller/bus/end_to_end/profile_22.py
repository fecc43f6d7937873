"""AUTOSAR profile 22, for classic CAN: CRC-8, a counter of four bits, 16 data ids for each message.

Source: AUTOSAR FO PRS E2EProtocol, "Specification of E2E Profile 22".
"""

from typing import Final

from rt_controller.bus.end_to_end.protection import Frame, Place
from rt_controller.contract.timing import COUNTER_MODULUS

_POLYNOMIAL = 0x2F
_ALL_ONES = 0xFF
FRAME_LENGTH = 8
COUNTER_MASK = 0x0F
"""of byte 1"""
_FLAG_PLACES = {
    True: (Place("Valid", 12, 1), Place("Cycle", 13, 3)),
    False: (Place("Mode", 12, 4),),
}


def _remainder(byte: int) -> int:
    for _ in range(8):
        byte = (byte << 1) ^ (_POLYNOMIAL if byte & 0x80 else 0)
    return byte & 0xFF


_TABLE = tuple(_remainder(byte) for byte in range(256))


def frame_crc(frame: Frame, data_id: int) -> int:
    """Byte 0 of an eight-byte frame: the CRC-8 of its other bytes and of the data id.

    The polynomial is 0x2F, start and final value are all ones, without reflection. AUTOSAR calls it
    CRC8H2F and uses it in profiles 2 and 22. It detects every error of up to three bits outside the
    counter. The data id, one byte that is not transmitted, depends on frame and counter: an intact
    frame under the id of another one fails the check. The data ids in the DBC are chosen so that
    every error of one or two bits anywhere is detected as well.
    """
    t = _TABLE
    _, a, b, c, d, e, f, g = frame  # written out: a loop would take twice as long
    return t[t[t[t[t[t[t[t[_ALL_ONES ^ a] ^ b] ^ c] ^ d] ^ e] ^ f] ^ g] ^ data_id] ^ _ALL_ONES


class Profile22:
    """Byte 0 is the CRC, byte 1 the counter (low nibble) and the flags (high nibble)."""

    head_format: Final = "<xB"
    head_bits: Final = 16
    largest_flags: Final = 15
    modulus: Final = COUNTER_MODULUS

    def __init__(self, data_ids: bytes) -> None:
        """Protect frames of the message with these data ids, one for each counter."""
        self.data_ids = data_ids

    @staticmethod
    def places(has_valid_flag: bool) -> tuple[Place, ...]:
        return Place("Crc", 0, 8), Place("Counter", 8, 4), *_FLAG_PLACES[has_valid_flag]

    @staticmethod
    def head(counter: int, flags: int) -> tuple[int, ...]:
        return (flags << 4 | counter,)

    def protect(self, frame: bytearray) -> None:
        frame[0] = frame_crc(frame, self.data_ids[frame[1] & COUNTER_MASK])

    def is_intact(self, frame: Frame) -> bool:
        return (
            len(frame) == FRAME_LENGTH
            and frame_crc(frame, self.data_ids[frame[1] & COUNTER_MASK]) == frame[0]
        )

    @staticmethod
    def counter_of(frame: Frame) -> int:
        return frame[1] & COUNTER_MASK

    @staticmethod
    def flags_of(frame: Frame) -> int:
        return frame[1] >> 4
