"""Reading a bus: the newest complete content of each message, and counts of what is wrong.

Every frame is checked as AUTOSAR's end-to-end profile 22 demands it: checksum, sequence of
counters, state of the link. Source: AUTOSAR FO PRS E2EProtocol, "E2E_P22Check" and "E2E state
machine".

`drain` never blocks and never raises. A bus that fails is counted and reported; the rest of the
program treats it as a bus on which nothing arrives.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import can

from rt_controller.bus.codec import DAMAGED, FrameCodec
from rt_controller.bus.condition import BusCondition, BusState
from rt_controller.bus.log.recorder import Recorder
from rt_controller.bus.messages import CATALOGUE, Catalogue, Message, Node
from rt_controller.bus.transport import overflowed_frames
from rt_controller.contract.errors import BusError
from rt_controller.contract.timing import COUNTER_MODULUS, PERIOD_NS

MAX_FRAMES_PER_DRAIN = 1024
"""It bounds the time of one drain if a bus is flooded. In one period a full bus of 1 Mbit/s carries
225 frames of 8 bytes or 530 empty ones, so that a backlog is read within a few periods."""
BACKLOG_FRAMES = 32
"""so many at once are more than a period brings: frames may have been lost before"""
MAX_DELTA_COUNTER = 6
"""largest difference of two counters in a row that is accepted: the five periods for which a drive
goes on without a path, and one; below half of 16, so that of two senders one is always refused"""
CONFLICT_NS = 2 * PERIOD_NS
"""a frame whose counter goes back so soon after another one is of a second sender, or an old one"""
MAX_SPREAD_NS = COUNTER_MODULUS // 2 * PERIOD_NS
"""Frames with one counter that arrived farther apart may be of different cycles of the counter."""

_NO_COUNTER = -1
_LONG_AGO_NS = -MAX_SPREAD_NS

T = TypeVar("T")


class ReceivingBus(Protocol):
    """What an inbox needs of a bus; `can.BusABC` has it."""

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame, or None after the time."""
        ...


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
    """wrong checksum or length, or a frame of CAN FD; dropped"""
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


class LinkState(Enum):
    """State of the E2E state machine; only in VALID data may be used."""

    NO_DATA = "nothing was received yet"
    INIT = "the first frames were received"
    VALID = "the communication works"
    INVALID = "too many errors, or too few good frames"


class Window(NamedTuple):
    """What a state looks at: so many of the last frames, and of them the good and damaged ones."""

    frames: int
    least_good: int
    most_damaged: int


WINDOWS = {
    LinkState.INIT: Window(4, 1, 1),
    LinkState.VALID: Window(8, 1, 3),
    LinkState.INVALID: Window(4, 3, 0),
}
"""VALID is left after 8 periods without a good frame, or 4 damaged frames in 8, and reached again
after 3 good ones: longer than a plan is held, so that a sender which comes back finds the car in a
safe stop"""


class Link:
    """The E2E state machine of one frame identifier that is sent every period."""

    __slots__ = ("damaged", "good", "state")

    def __init__(self) -> None:
        self.state = LinkState.NO_DATA
        self.good = self.damaged = 0
        """of the last eight frames, one bit each, the newest one lowest"""

    def add(self, is_good: bool, is_damaged: bool = False, is_missing: bool = False) -> None:
        """Take one frame, or one period in which it is missing.

        A frame that is neither good nor damaged has a wrong counter.
        """
        if self.state is LinkState.NO_DATA:
            if not (is_damaged or is_missing):
                self.state = LinkState.INIT
            return
        self.good = (self.good << 1 | is_good) & 0xFF
        self.damaged = (self.damaged << 1 | is_damaged) & 0xFF
        if is_good and self.damaged == 0 and self.state is LinkState.VALID:
            return  # the usual case
        window = WINDOWS[self.state]
        mask = (1 << window.frames) - 1
        is_damaged = (self.damaged & mask).bit_count() > window.most_damaged
        is_enough = (self.good & mask).bit_count() >= window.least_good
        if self.state is LinkState.INIT:
            if is_damaged:
                self.state = LinkState.INVALID
            elif is_enough:
                self.state = LinkState.VALID
        else:
            self.state = LinkState.VALID if is_enough and not is_damaged else LinkState.INVALID


class _Assembly:
    """The frames of one message as they arrive, and its newest complete content."""

    __slots__ = ("arrivals_ns", "conflict_ns", "counters", "links", "message", "newest",
                 "out_of_range", "refused", "slots", "values")  # fmt: skip

    def __init__(self, message: Message[Any], is_own: bool) -> None:
        codecs = message.codecs
        self.message = message
        self.newest: Received[Any] | None = None
        self.out_of_range = 0
        """intact frames that were dropped for their values"""
        self.refused: tuple[FrameCodec, bytes, Received[Any] | None] | None = None
        """the first of those frames since the newest content, and that content"""
        self.conflict_ns = _LONG_AGO_NS
        """arrival of the last frame that contradicts another one"""
        self.values: list[tuple[float, ...]] = [()] * len(codecs)
        self.counters = [_NO_COUNTER] * len(codecs)
        """of `values`; `_NO_COUNTER` where the newest frame must not be used"""
        self.arrivals_ns = [0] * len(codecs)
        is_cyclic = message.cycle_ticks == 1
        self.slots = [
            _Slot(self, place, codec, Link() if is_cyclic else None, is_own)
            for place, codec in enumerate(codecs)
        ]
        self.links = [slot.link for slot in self.slots if slot.link is not None]
        """of messages that are sent every period; slower ones are judged by their age"""


class _Slot:
    """One identifier: the frame that arrived last, and the place of its values in the message."""

    __slots__ = ("arrival_ns", "assembly", "codec", "counter", "frame", "is_own", "link", "modulus",
                 "place")  # fmt: skip

    def __init__(
        self, assembly: _Assembly, place: int, codec: FrameCodec, link: Link | None, is_own: bool
    ) -> None:
        self.assembly = assembly
        self.place = place
        self.codec = codec
        self.modulus = codec.counter_modulus
        self.link = link
        self.is_own = is_own
        self.counter = _NO_COUNTER
        """of the last intact frame, whether its values may be used or not"""
        self.frame = b""
        self.arrival_ns = _LONG_AGO_NS


class Inbox:
    """Receives for one node: the newest content of each message of the other node."""

    def __init__(
        self, node: Node, recorder: Recorder | None = None, catalogue: Catalogue = CATALOGUE
    ) -> None:
        self.counts = ReceptionCounts()
        self.condition = BusCondition()
        self.last_failure = ""
        """why the bus could not be read, for people; empty if it always could"""
        self.foreign_frames = 0
        """frames that only this node sends: a bus does not return what one sent, so these are
        from a second device in the same role"""
        self._recorder = recorder
        self._period_ns = 0
        """when the last period ended"""
        assemblies = [_Assembly(message, message.sender == node) for message in catalogue.messages]
        self._assemblies = {
            each.message: each for each in assemblies if each.message.sender != node
        }
        self._slots = {
            slot.codec.arbitration_id: slot for each in assemblies for slot in each.slots
        }
        self._cyclic = [
            (slot, slot.link)
            for each in self._assemblies.values()
            for slot in each.slots
            if slot.link is not None
        ]

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

    def newest_valid(self, message: Message[T], now_ns: int) -> Received[T] | None:
        """The newest content; None if its link is not valid, or frames contradict each other."""
        assembly = self._assemblies[message]
        if now_ns - assembly.conflict_ns < PERIOD_NS // 2:
            return None
        for link in assembly.links:
            if link.state is not LinkState.VALID:
                return None
        return assembly.newest

    def has_conflict(self, message: Message[Any], now_ns: int) -> bool:
        """True if frames of this message contradict each other: of two senders, or old ones.

        A conflict counts for half a period: until the next tick, not in it.
        """
        return now_ns - self._assemblies[message].conflict_ns < PERIOD_NS // 2

    def end_period(self, now_ns: int) -> None:
        """Once a period, after reading: count the frames that did not arrive."""
        since_ns = self._period_ns
        for slot, link in self._cyclic:
            if slot.arrival_ns < since_ns:
                link.add(is_good=False, is_missing=True)
        self._period_ns = now_ns + 1

    def out_of_range(self, message: Message[Any]) -> int:
        """Number of intact frames of this message with values that may not be used."""
        return self._assemblies[message].out_of_range

    def explain_out_of_range(self, message: Message[Any]) -> str:
        """What of this message may not be used, for people; empty if all could.

        Of its frames that is the first one after the content before.
        """
        refused = self._assemblies[message].refused
        return "" if refused is None else refused[0].objections(refused[1])

    def drain(self, bus: ReceivingBus, now_ns: int, most: int = MAX_FRAMES_PER_DRAIN) -> int:
        """Number of frames read, at most `most`; all are stamped `now_ns`.

        So an arrival can be late by the time since the previous call, and is never early. An
        interface that is down is no failure: it may come up again, and then frames arrive.
        """
        for n_frames in range(most):
            try:
                message = bus.recv(0)
            except Exception as error:  # each backend raises its own type
                if self.condition.note_failure(error):
                    return n_frames
                self.counts.receive_failures += 1
                self.last_failure = f"{type(error).__name__}: {error}"
                return n_frames
            if message is None:
                if n_frames > BACKLOG_FRAMES:
                    self.counts.overflowed = overflowed_frames(bus)
                return n_frames
            if self._recorder is not None:
                self._recorder.record(message, now_ns)
            self.accept(message, now_ns)
        return most

    def accept(self, message: can.Message, arrival_ns: int) -> None:
        """Check one frame and keep its content; frames of other ids are ignored."""
        if message.is_error_frame:
            self.condition.note_error_frame(message)
            return
        if self.condition.state is not BusState.ACTIVE:
            self.condition.note_frame()
        slot = self._slots.get(message.arbitration_id)
        if slot is None or message.is_extended_id or message.is_remote_frame:
            return
        link, counts = slot.link, self.counts
        frame = message.data
        counter = DAMAGED if message.is_fd else slot.codec.check(frame)
        if counter == DAMAGED:
            counts.crc_errors += 1
            if link is not None:
                link.add(is_good=False, is_damaged=True)
            return

        delta = 1 if slot.counter == _NO_COUNTER else (counter - slot.counter) % slot.modulus
        is_good = 0 < delta <= MAX_DELTA_COUNTER
        if is_good:
            counts.counter_gap_frames += delta - 1
        else:
            self._note_wrong_counter(slot, delta, frame, arrival_ns)
        slot.counter, slot.frame, slot.arrival_ns = counter, bytes(frame), arrival_ns
        if link is not None:
            link.add(is_good)
        if slot.is_own:
            self.foreign_frames += delta != 0
        elif is_good:
            self._keep(slot, frame, counter, arrival_ns)

    def _note_wrong_counter(
        self, slot: _Slot, delta: int, frame: bytearray, arrival_ns: int
    ) -> None:
        """A counter that is repeated, goes back, or is too far ahead: of a second sender, maybe."""
        counts, assembly = self.counts, slot.assembly
        if delta == 0:
            counts.repeated += 1
            is_conflict = slot.frame != frame
            counts.contradicting += is_conflict
        else:
            counts.wrong_sequence += 1
            assembly.counters[slot.place] = _NO_COUNTER
            is_conflict = arrival_ns - slot.arrival_ns < CONFLICT_NS  # not the end of a silence
        if is_conflict:
            assembly.conflict_ns = arrival_ns

    def _keep(self, slot: _Slot, frame: bytearray, counter: int, arrival_ns: int) -> None:
        """The values of a frame; with the last frame of a counter the content is complete."""
        codec, assembly, place = slot.codec, slot.assembly, slot.place
        counters = assembly.counters
        values = codec.read(frame)
        if values is None:
            counters[place] = _NO_COUNTER
            assembly.out_of_range += 1
            self.counts.out_of_range += 1
            if assembly.refused is None or assembly.refused[2] is not assembly.newest:
                assembly.refused = codec, slot.frame, assembly.newest
            return
        assembly.values[place] = values
        counters[place] = counter
        assembly.arrivals_ns[place] = arrival_ns
        if counters.count(counter) < len(counters):
            return  # the other frames of this counter are missing yet
        oldest_ns = min(assembly.arrivals_ns)
        if arrival_ns - oldest_ns <= MAX_SPREAD_NS:
            content = assembly.message.decode(assembly.values)
            assembly.newest = Received(content, counter, oldest_ns)
