"""What the codec needs of a profile of the end-to-end protection: the head of a frame, its check.

The head is the CRC, the counter, and flags: Valid, or Mode where that is part of the content.
"""

from typing import NamedTuple, Protocol

Frame = bytes | bytearray


class Place(NamedTuple):
    """A signal of the head."""

    name: str
    first_bit: int
    n_bits: int


class Protection(Protocol):
    """The protection of the frames of one identifier."""

    @property
    def head_format(self) -> str:
        """struct format of the head, the CRC left out."""

    @property
    def head_bits(self) -> int:
        """Length of the head in bits, the CRC included."""

    @property
    def largest_flags(self) -> int:
        """Largest value of the flags beside the counter."""

    @property
    def modulus(self) -> int:
        """Number of values of the counter."""

    def places(self, has_valid_flag: bool) -> tuple[Place, ...]:
        """The signals of the head in a DBC."""

    def head(self, counter: int, flags: int) -> tuple[int, ...]:
        """The values of the head in the struct format."""

    def protect(self, frame: bytearray) -> None:
        """Write the CRC of a frame whose other bytes are complete."""

    def is_intact(self, frame: Frame) -> bool:
        """True if length and CRC are those of this message."""

    def counter_of(self, frame: Frame) -> int:
        """Counter of an intact frame, below `modulus`."""

    def flags_of(self, frame: Frame) -> int:
        """Flags of an intact frame."""
