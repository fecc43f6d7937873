"""Reading a bus: which frames are admitted, and counts of those that are not.

Reading never blocks and never raises. A bus that fails is counted and reported; to the rest of
the program it is a bus on which nothing arrives.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import can

from rt_controller.bus.codec import Frame, MessageCodec, counter_of
from rt_controller.bus.recorder import FrameSink
from rt_controller.contract.timing import COUNTER_MODULUS

MAX_FRAMES_PER_DRAIN = 512
"""A flooded bus must not hold up the step: no physical bus brings more in ten periods."""

Handler = Callable[[Frame, int, int], bool]
"""Takes an admitted frame, its counter and arrival; False if its values must not be used."""


class ReceptionCounts(NamedTuple):
    """What went wrong with the frames addressed to this side, since the start."""

    crc_errors: int
    """wrong checksum or length; dropped"""
    repeated: int
    """same counter as the frame before: the sender is stuck; dropped"""
    lost: int
    """gaps in the counters"""
    out_of_range: int
    """whole frames with values that are missing or outside their range; dropped"""
    error_frames: int
    """the bus itself reports trouble"""
    receive_failures: int
    """the interface failed to read"""


class _Source:
    """One message that is listened to, and the counter it came with last."""

    __slots__ = ("codec", "counter", "handle")

    def __init__(self, codec: MessageCodec, handle: Handler) -> None:
        self.codec = codec
        self.handle = handle
        self.counter = -1


class Reception:
    """Admits the frames of some messages and hands them on."""

    def __init__(
        self, handlers: Mapping[MessageCodec, Handler], recorder: FrameSink | None
    ) -> None:
        self.last_failure = ""
        self._sources = {
            codec.arbitration_id: _Source(codec, handle) for codec, handle in handlers.items()
        }
        self._recorder = recorder
        self._crc_errors = 0
        self._repeated = 0
        self._lost = 0
        self._out_of_range = 0
        self._error_frames = 0
        self._receive_failures = 0

    @property
    def counts(self) -> ReceptionCounts:
        return ReceptionCounts(
            self._crc_errors,
            self._repeated,
            self._lost,
            self._out_of_range,
            self._error_frames,
            self._receive_failures,
        )

    def drain(self, bus: can.BusABC, now_ns: int, most: int = MAX_FRAMES_PER_DRAIN) -> int:
        """How many frames were read, at most so many; all are stamped `now_ns`.

        So an arrival can be late by the time since the previous call, and is never early.
        """
        for n_frames in range(most):
            try:
                message = bus.recv(0)
            except Exception as error:  # each backend raises its own kind
                self._receive_failures += 1
                self.last_failure = f"{type(error).__name__}: {error}"
                return n_frames
            if message is None:
                return n_frames
            if self._recorder is not None:
                self._recorder.record(message, now_ns)
            self.accept(message, now_ns)
        return most

    def accept(self, message: can.Message, arrival_ns: int) -> None:
        """Check one frame and hand it on; frames of other messages are none of our business."""
        if message.is_error_frame:
            self._error_frames += 1
            return
        source = self._sources.get(message.arbitration_id)
        if source is None or message.is_extended_id or message.is_remote_frame:
            return
        frame = message.data
        if not source.codec.is_intact(frame):
            self._crc_errors += 1
            return
        counter = counter_of(frame)
        if source.counter >= 0:
            step = (counter - source.counter) % COUNTER_MODULUS
            if step == 0:
                self._repeated += 1
                return
            self._lost += step - 1
        source.counter = counter
        if not source.handle(frame, counter, arrival_ns):
            self._out_of_range += 1
