"""Reading a bus: the newest complete content of each message, and counts of what is wrong.

`drain` never blocks and never raises. A bus that fails is counted and reported; the rest of the
program treats it as a bus on which nothing arrives.
"""

from typing import Any, Protocol, TypeVar

import can

from rt_controller.bus.catalogue import CATALOGUE
from rt_controller.bus.condition import BusCondition
from rt_controller.bus.end_to_end.assembly import Assembly, Received, ReceptionCounts
from rt_controller.bus.end_to_end.sequence_check import CheckStatus, LinkState
from rt_controller.bus.log.recorder import Recorder
from rt_controller.bus.message import Catalogue, Message, Node
from rt_controller.bus.transport import overflowed_frames
from rt_controller.contract.errors import BusError
from rt_controller.contract.timing import PERIOD_NS

MAX_FRAMES_PER_DRAIN = 1024
"""It bounds the time of one drain if a bus is flooded. In one period a full bus of 1 Mbit/s carries
225 frames of 8 bytes or 530 empty ones, so that a backlog is read within a few periods."""
BACKLOG_FRAMES = 32
"""so many at once are more than a period brings: frames may have been lost before"""

T = TypeVar("T")


class ReceivingBus(Protocol):
    """What an inbox needs of a bus; `can.BusABC` has it."""

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame, or None after the time."""
        ...


class Inbox:
    """Receives for one node: the newest content of each message of the other node."""

    def __init__(
        self,
        node: Node,
        recorder: Recorder | None = None,
        catalogue: Catalogue = CATALOGUE,
        is_fd: bool = False,
    ) -> None:
        """`is_fd`: the frames of CAN FD instead of the classic ones."""
        self.is_fd = is_fd
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
        assemblies = [Assembly(message, is_fd) for message in catalogue.messages]
        self._assemblies = {
            each.message: each for each in assemblies if each.message.sender != node
        }
        self._cyclic = [each for each in self._assemblies.values() if each.links]
        self._frames = {
            codec.arbitration_id: (assembly, place, codec, assembly.message.sender == node)
            for assembly in assemblies
            for place, codec in enumerate(assembly.codecs)
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

    def newest_valid(self, message: Message[T], now_ns: int) -> Received[T] | None:
        """The newest content; None if its link is not valid, or frames contradict each other."""
        assembly = self._assemblies[message]
        if self.has_conflict(message, now_ns):
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
        for assembly in self._cyclic:
            assembly.end_period(self._period_ns)
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
        self.condition.note_frame()
        known = self._frames.get(message.arbitration_id)
        if known is None or message.is_extended_id or message.is_remote_frame:
            return
        assembly, place, codec, is_own = known
        frame = message.data
        is_other = message.is_fd is not self.is_fd
        if is_other or not codec.is_intact(frame):
            self.counts.other_format += is_other
            self.counts.crc_errors += not is_other
            if assembly.links:
                assembly.links[place].add(CheckStatus.ERROR)
            return
        counter = codec.counter_of(frame)
        status = assembly.check(place, counter, frame, arrival_ns, self.counts)
        if status is CheckStatus.REPEATED:
            return
        if is_own:
            self.foreign_frames += 1
        elif status is CheckStatus.WRONG_SEQUENCE:
            return
        elif (part := codec.read(frame)) is None:
            assembly.refuse(place, codec, frame)
            self.counts.out_of_range += 1
        else:
            assembly.add(place, part, counter, arrival_ns)
