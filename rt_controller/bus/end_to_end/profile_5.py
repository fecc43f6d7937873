"""AUTOSAR profile 5, for CAN FD: CRC-16, a counter of eight bits, one data id of 16 bits.

Source: AUTOSAR FO PRS E2EProtocol, "Specification of E2E Profile 5".
"""

from binascii import crc_hqx
from typing import Final

from rt_controller.bus.end_to_end.protection import Frame, Place

_ALL_ONES = 0xFFFF
_CRC_LENGTH = 2
_COUNTER, _FLAGS = 2, 3
"""their bytes"""


def frame_crc(frame: Frame, data_id: int) -> int:
    """Bytes 0 and 1, the lower one first: the CRC-16 of the other bytes and of the data id.

    The polynomial is 0x1021, the start value is all ones, without reflection. It detects every
    error of up to three bits in frames of CAN FD. The data id, two bytes that are not transmitted,
    belongs to one message: an intact frame under the id of another one fails the check.
    """
    return crc_hqx(data_id.to_bytes(2, "little"), crc_hqx(frame[_CRC_LENGTH:], _ALL_ONES))


class Profile5:
    """Bytes 0 and 1 are the CRC, byte 2 the counter, byte 3 the flags."""

    head_format: Final = "<xxBB"
    head_bits: Final = 32
    largest_flags: Final = 255
    modulus: Final = 256

    def __init__(self, data_id: int, length: int) -> None:
        """Protect frames of `length` bytes of the message with this data id."""
        self.data_id = data_id
        self._length = length

    @staticmethod
    def places(has_valid_flag: bool) -> tuple[Place, ...]:
        flag = Place("Valid" if has_valid_flag else "Mode", 24, 8)
        return Place("Crc", 0, 16), Place("Counter", 16, 8), flag

    @staticmethod
    def head(counter: int, flags: int) -> tuple[int, ...]:
        return counter, flags

    def protect(self, frame: bytearray) -> None:
        frame[:_CRC_LENGTH] = frame_crc(frame, self.data_id).to_bytes(_CRC_LENGTH, "little")

    def is_intact(self, frame: Frame) -> bool:
        return len(frame) == self._length and frame_crc(frame, self.data_id) == (
            frame[0] | frame[1] << 8
        )

    @staticmethod
    def counter_of(frame: Frame) -> int:
        return frame[_COUNTER]

    @staticmethod
    def flags_of(frame: Frame) -> int:
        return frame[_FLAGS]
