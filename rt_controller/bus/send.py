"""Writing to a bus: each message with its counter and checksum.

Sending never blocks and never raises: a frame that the interface does not take is counted, and
its counter is used up, so that the receiver detects the gap.
"""

from typing import Any, Protocol, TypeVar

import can

from rt_controller.bus.codec import FRAME_LENGTH
from rt_controller.bus.condition import is_queue_full
from rt_controller.bus.log.recorder import Recorder
from rt_controller.bus.messages import CATALOGUE, Catalogue, Message, Node
from rt_controller.contract.timing import LONG_COUNTER_MODULUS

T = TypeVar("T")


class SendingBus(Protocol):
    """What an outbox needs of a bus; `can.BusABC` has it."""

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame, or raise."""
        ...


class DiscardBus:
    """CAN bus that discards every frame."""

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Discard the frame."""


class _Outgoing:
    """One message as it is sent: its prepared frames and its counter.

    The frames are used again and again: every backend of python-can has copied or serialised
    a frame when `send` returns.
    """

    __slots__ = ("counter", "frames", "values_of")

    def __init__(self, message: Message[Any]) -> None:
        self.counter = -1
        self.values_of = message.values_of
        self.frames = [
            (
                can.Message(
                    arbitration_id=codec.arbitration_id,
                    is_extended_id=False,
                    is_rx=False,
                    data=bytes(FRAME_LENGTH),
                    check=True,
                ),
                codec,
                part,
            )
            for codec, part in message.parts
        ]


class Outbox:
    """Sends the messages of one node, with counters and checksums."""

    def __init__(
        self,
        bus: SendingBus,
        node: Node,
        recorder: Recorder | None = None,
        catalogue: Catalogue = CATALOGUE,
    ) -> None:
        self.sent = 0  # frames
        self.send_failures = 0
        self.queue_full = 0
        """of these failures: the queue of frames to be sent was full"""
        self.last_failure = ""
        """why a frame was not taken, for people; empty if all were"""
        self._bus = bus
        self._recorder = recorder
        self._outgoing = {
            message: _Outgoing(message) for message in catalogue.messages if message.sender == node
        }

    def send(
        self,
        message: Message[T],
        content: T,
        now_ns: int,
        *,
        counter: int | None = None,
        is_valid: bool = True,
    ) -> None:
        """Send all frames of one message.

        Args:
            message: one that this node sends.
            content: its content.
            now_ns: stamp for the recorder.
            counter: taken modulo 128; None: one more than that of the last sending.
            is_valid: False tells the receiver not to use the values.
        """
        outgoing = self._outgoing[message]
        counter = (outgoing.counter + 1 if counter is None else counter) % LONG_COUNTER_MODULUS
        outgoing.counter = counter
        values = outgoing.values_of(content)
        for frame, codec, part in outgoing.frames:
            frame.data[:] = codec.write(values[part], counter, is_valid)
            try:
                self._bus.send(frame, timeout=0)
            except Exception as error:  # each backend raises its own type
                self.send_failures += 1
                self.queue_full += is_queue_full(error)
                self.last_failure = f"{type(error).__name__}: {error}"
                continue
            self.sent += 1
            if self._recorder is not None:
                self._recorder.record(frame, now_ns, is_sent=True)
