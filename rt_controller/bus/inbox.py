"""Reading a bus: the newest complete content of each message, and counts of what is wrong.

`drain` never blocks and never raises. A bus that fails is counted and reported; the rest of the
program treats it as a bus on which nothing arrives.
"""

from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

import can

from rt_controller.bus.catalogue import CATALOGUE
from rt_controller.bus.codec import COUNTER_MASK, FrameCodec
from rt_controller.bus.message import Catalogue, Message, Node
from rt_controller.bus.recorder import Recorder
from rt_controller.contract.errors import BusError
from rt_controller.contract.timing import COUNTER_MODULUS, PERIOD_NS

MAX_FRAMES_PER_DRAIN = 1024
"""It bounds the time of one drain if a bus is flooded. In one period a full bus of 1 Mbit/s carries
225 frames of 8 bytes or 530 empty ones, so that a backlog is read within a few periods."""
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
    repeated: int = 0
    """same counter as the frame before, so the sender has stopped working; dropped"""
    counter_gap_frames: int = 0
    """frames that are missing between two counters of one sender"""
    out_of_range: int = 0
    """intact frames with values that are missing or outside their range; dropped"""
    error_frames: int = 0
    receive_failures: int = 0


class _Assembly:
    """The frames of one message as they arrive, and its newest complete content."""

    __slots__ = (
        "arrivals_ns",
        "counters",
        "last_counters",
        "message",
        "newest",
        "out_of_range",
        "parts",
        "refused",
    )

    def __init__(self, message: Message[Any]) -> None:
        n_frames = len(message.codecs)
        self.message = message
        self.newest: Received[Any] | None = None
        self.out_of_range = 0
        """intact frames that were dropped for their values"""
        self.refused: tuple[FrameCodec, bytes, Received[Any] | None] | None = None
        """the first of those frames since the newest content, and that content"""
        self.last_counters = [_NO_COUNTER] * n_frames
        """of the intact frames, whether their values may be used or not"""
        self.parts: list[tuple[float, ...]] = [()] * n_frames
        self.counters = [_NO_COUNTER] * n_frames
        """of the frames in `parts`; `_NO_COUNTER` where the newest one must not be used"""
        self.arrivals_ns = [0] * n_frames

    def refuse(self, place: int, codec: FrameCodec, frame: bytearray) -> None:
        self.counters[place] = _NO_COUNTER
        self.out_of_range += 1
        if self.refused is None or self.refused[2] is not self.newest:
            self.refused = codec, bytes(frame), self.newest

    def add(self, place: int, part: tuple[float, ...], counter: int, now_ns: int) -> None:
        self.parts[place] = part
        self.counters[place] = counter
        self.arrivals_ns[place] = now_ns
        if self.counters.count(counter) < len(self.counters):
            return
        arrival_ns = min(self.arrivals_ns)
        if max(self.arrivals_ns) - arrival_ns <= MAX_SPREAD_NS:
            self.newest = Received(self.message.decode(self.parts), counter, arrival_ns)


class Inbox:
    """Receives for one node: the newest content of each message of the other node."""

    def __init__(
        self, node: Node, recorder: Recorder | None = None, catalogue: Catalogue = CATALOGUE
    ) -> None:
        self.counts = ReceptionCounts()
        self.last_failure = ""
        """why the bus could not be read, for people; empty if it always could"""
        self.foreign_frames = 0
        """frames that only this node sends: a bus does not return what one sent, so these are
        from a second device in the same role"""
        self._recorder = recorder
        assemblies = [_Assembly(message) for message in catalogue.messages]
        self._assemblies = {
            each.message: each for each in assemblies if each.message.sender != node
        }
        self._frames = {
            codec.arbitration_id: (assembly, place, codec, assembly.message.sender == node)
            for assembly in assemblies
            for place, codec in enumerate(assembly.message.codecs)
        }

    def require_readable(self) -> None:
        """Return if the bus could be read so far.

        Raises:
            BusError: it could not.
        """
        if self.last_failure:
            raise BusError(
                f"The bus cannot be read: expected frames or silence, found {self.last_failure}. "
                f"Check the interface and its connection, then start again."
            )

    def newest(self, message: Message[T]) -> Received[T] | None:
        """The newest content of this message, however old it is; None before the first."""
        return self._assemblies[message].newest

    def out_of_range(self, message: Message[Any]) -> int:
        """Number of intact frames of this message with values that may not be used."""
        return self._assemblies[message].out_of_range

    def explain_out_of_range(self, message: Message[Any]) -> str:
        """What of this message may not be used, for people; empty if all could.

        Of its frames that is the first one after the content before.
        """
        refused = self._assemblies[message].refused
        return "" if refused is None else refused[0].objections(refused[1])

    def drain(self, bus: can.BusABC, now_ns: int, most: int = MAX_FRAMES_PER_DRAIN) -> int:
        """Number of frames read, at most `most`; all are stamped `now_ns`.

        So an arrival can be late by the time since the previous call, and is never early.
        """
        for n_frames in range(most):
            try:
                message = bus.recv(0)
            except Exception as error:  # each backend raises its own type
                self.counts.receive_failures += 1
                self.last_failure = f"{type(error).__name__}: {error}"
                return n_frames
            if message is None:
                return n_frames
            if self._recorder is not None:
                self._recorder.record(message, now_ns)
            self.accept(message, now_ns)
        return most

    def accept(self, message: can.Message, arrival_ns: int) -> None:
        """Check one frame and keep its content; frames of other ids are ignored."""
        if message.is_error_frame:
            self.counts.error_frames += 1
            return
        known = self._frames.get(message.arbitration_id)
        if known is None or message.is_extended_id or message.is_remote_frame:
            return
        assembly, place, codec, is_own = known
        frame = message.data
        if not codec.is_intact(frame):
            self.counts.crc_errors += 1
            return
        counter = frame[1] & COUNTER_MASK
        last_counter = assembly.last_counters[place]
        step = (counter - last_counter) % COUNTER_MODULUS
        if step != 1 and last_counter != _NO_COUNTER:
            if step == 0:
                self.counts.repeated += 1
                return
            self.counts.counter_gap_frames += step - 1
        assembly.last_counters[place] = counter
        if is_own:
            self.foreign_frames += 1
        elif (part := codec.read(frame)) is None:
            assembly.refuse(place, codec, frame)
            self.counts.out_of_range += 1
        else:
            assembly.add(place, part, counter, arrival_ns)
