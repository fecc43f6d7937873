"""The frames of one message as they arrive: checked for their sequence, joined to a content."""

from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

from rt_controller.bus.codec import FrameCodec
from rt_controller.bus.end_to_end.sequence_check import CheckStatus, Link, check_counter
from rt_controller.bus.message import Message
from rt_controller.contract.timing import COUNTER_MODULUS, PERIOD_NS

CONFLICT_NS = 2 * PERIOD_NS
"""a frame whose counter goes back so soon after another one is of a second sender, or an old one"""
MAX_SPREAD_NS = COUNTER_MODULUS // 2 * PERIOD_NS
"""Frames with one counter that arrived farther apart may be of different cycles of the counter."""

_NO_COUNTER = -1

T = TypeVar("T")


class Received(NamedTuple, Generic[T]):
    """A complete, checked and valid content."""

    content: T
    counter: int
    """end-to-end counter of its frames"""
    arrival_ns: int
    """the reader's clock when the oldest of its frames was read from the bus"""


@dataclass(slots=True)
class ReceptionCounts:
    """What was wrong with the frames of this catalogue, since the start."""

    crc_errors: int = 0
    """wrong checksum or length; dropped"""
    other_format: int = 0
    """frames of CAN FD on a bus of classic frames, or the reverse; dropped"""
    repeated: int = 0
    """same counter as the frame before, so the sender has stopped working; dropped"""
    contradicting: int = 0
    """of those the ones with another content, so of a second sender"""
    wrong_sequence: int = 0
    """a counter that goes back, or too far ahead; dropped"""
    counter_gap_frames: int = 0
    """frames that are missing between two counters of one sender"""
    out_of_range: int = 0
    """intact frames with values that are missing or outside their range; dropped"""
    overflowed: int = 0
    """lost in the receive buffer of the socket, because it was not read in time"""
    receive_failures: int = 0


class Assembly:
    """The frames of one message as they arrive, and its newest complete content."""

    __slots__ = (
        "arrivals_ns",
        "codecs",
        "conflict_ns",
        "counters",
        "last_arrivals_ns",
        "last_counters",
        "last_frames",
        "links",
        "message",
        "moduli",
        "newest",
        "out_of_range",
        "parts",
        "refused",
    )

    def __init__(self, message: Message[Any], is_fd: bool) -> None:
        self.codecs = message.codecs_of(is_fd)
        n_frames = len(self.codecs)
        self.message = message
        self.newest: Received[Any] | None = None
        self.out_of_range = 0
        """intact frames that were dropped for their values"""
        self.refused: tuple[FrameCodec, bytes, Received[Any] | None] | None = None
        """the first of those frames since the newest content, and that content"""
        self.last_counters = [_NO_COUNTER] * n_frames
        """of the intact frames, whether their values may be used or not"""
        self.last_frames = [b""] * n_frames
        self.moduli = [codec.counter_modulus for codec in self.codecs]
        self.last_arrivals_ns = [-MAX_SPREAD_NS] * n_frames
        self.links = [Link() for _ in range(n_frames if message.cycle_ticks == 1 else 0)]
        """of messages that are sent every period; slower ones are judged by their age"""
        self.conflict_ns = -MAX_SPREAD_NS
        """arrival of the last frame that contradicts another one"""
        self.parts: list[tuple[float, ...]] = [()] * n_frames
        self.counters = [_NO_COUNTER] * n_frames
        """of the frames in `parts`; `_NO_COUNTER` where the newest one must not be used"""
        self.arrivals_ns = [0] * n_frames

    def check(
        self, place: int, counter: int, frame: bytearray, now_ns: int, counts: ReceptionCounts
    ) -> CheckStatus:
        """Status of an intact frame; it is the last one from now on."""
        last = self.last_counters[place]
        modulus = self.moduli[place]
        status = CheckStatus.OK if last == _NO_COUNTER else check_counter(counter, last, modulus)
        if status is CheckStatus.OK_SOME_LOST:
            counts.counter_gap_frames += (counter - last - 1) % modulus
        elif status is CheckStatus.REPEATED:
            counts.repeated += 1
            if self.last_frames[place] != frame:
                counts.contradicting += 1
                self.conflict_ns = now_ns
        elif status is CheckStatus.WRONG_SEQUENCE:
            counts.wrong_sequence += 1
            self.counters[place] = _NO_COUNTER
            if now_ns - self.last_arrivals_ns[place] < CONFLICT_NS:  # not the end of a silence
                self.conflict_ns = now_ns
        self.last_counters[place] = counter
        self.last_frames[place] = bytes(frame)
        self.last_arrivals_ns[place] = now_ns
        if self.links:
            self.links[place].add(status)
        return status

    def end_period(self, since_ns: int) -> None:
        """Add to the links the frames that have not arrived since this time."""
        for link, arrival_ns in zip(self.links, self.last_arrivals_ns, strict=False):
            if arrival_ns < since_ns:
                link.add(CheckStatus.NO_NEW_DATA)

    def refuse(self, place: int, codec: FrameCodec, frame: bytearray) -> None:
        """Count an intact frame whose values may not be used; no content is made with it."""
        self.counters[place] = _NO_COUNTER
        self.out_of_range += 1
        if self.refused is None or self.refused[2] is not self.newest:
            self.refused = codec, bytes(frame), self.newest

    def add(self, place: int, part: tuple[float, ...], counter: int, now_ns: int) -> None:
        """Keep the values of a frame; with the last frame of a counter the content is complete."""
        self.parts[place] = part
        self.counters[place] = counter
        self.arrivals_ns[place] = now_ns
        if self.counters.count(counter) < len(self.counters):
            return
        arrival_ns = min(self.arrivals_ns)
        if max(self.arrivals_ns) - arrival_ns <= MAX_SPREAD_NS:
            self.newest = Received(self.message.decode(self.parts), counter, arrival_ns)
