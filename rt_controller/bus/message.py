"""What a message is: one content of the program, carried by one or more CAN frames.

A new message needs its frames in `messages.dbc`, one `Catalogue.define` in `catalogue.py`, and one
call: `Outbox.send(MESSAGE, content, now_ns)` or `Inbox.newest(MESSAGE)`.
"""

from collections.abc import Callable, Iterable
from enum import StrEnum
from itertools import accumulate, chain
from pathlib import Path
from typing import Any, Generic, TypeVar

from rt_controller.bus.codec import FrameCodec, FrameSpec
from rt_controller.bus.dbc import misfit, read_dbc
from rt_controller.contract.timing import PERIOD_MS

T = TypeVar("T")


class Node(StrEnum):
    """The two ends of the bus, as the DBC names them."""

    CONTROLLER = "CONTROLLER"
    VEHICLE = "VEHICLE"


class Message(Generic[T]):
    """One content and the frames that carry it; several frames belong together by their counter."""

    def __init__(
        self,
        sender: Node,
        codecs: tuple[FrameCodec, ...],
        cycle_ticks: int,
        encode: Callable[[T], tuple[float, ...]],
        decode: Callable[..., T],
    ) -> None:
        self.sender = sender
        self.codecs = codecs
        self.cycle_ticks = cycle_ticks
        self._encode = encode
        self._decode = decode
        ends = accumulate(codec.n_values for codec in codecs)
        self._parts = tuple(
            (codec, slice(end - codec.n_values, end))
            for codec, end in zip(codecs, ends, strict=True)
        )

    @property
    def cycle_ms(self) -> float:
        return self.cycle_ticks * PERIOD_MS

    def encode(self, content: T, counter: int, is_valid: bool = True) -> list[bytes]:
        """One protected frame of eight bytes for each codec, all with this counter (0..15)."""
        values = self._encode(content)
        if len(self.codecs) == 1:
            return [self.codecs[0].write(values, counter, is_valid)]
        return [codec.write(values[part], counter, is_valid) for codec, part in self._parts]

    def decode(self, parts: Iterable[tuple[float, ...]]) -> T:
        """The content of what `FrameCodec.read` returned for each frame."""
        return self._decode(*chain.from_iterable(parts))


class Catalogue:
    """All messages of one DBC file, in the order of their definitions."""

    def __init__(self, path: Path) -> None:
        self._dbc = read_dbc(path)
        self.messages: list[Message[Any]] = []

    def define(
        self,
        *frames: FrameSpec,
        cycle_ticks: int,
        encode: Callable[[T], tuple[float, ...]],
        decode: Callable[..., T],
    ) -> Message[T]:
        """A message of the catalogue; its sender and the layout of its frames come from the DBC.

        Args:
            frames: the frames that carry it, in the order of the values.
            cycle_ticks: control periods from one sending to the next.
            encode: physical values of all frames, flat, from the content; a nibble other than
                "Valid" comes before the other signals of its frame. NaN means not available.
            decode: the content from the same values, which are within their ranges.

        Raises:
            ConfigError: the DBC lacks a frame, or has a layout that the codec does not support.
        """
        codecs = tuple(FrameCodec(self._dbc, frame) for frame in frames)
        senders = {codec.sender for codec in codecs}
        names = ", ".join(frame.name for frame in frames)
        if len(senders) != 1 or not senders <= set(Node):
            raise misfit(names, f"with one sender of {', '.join(Node)}", str(sorted(senders)))
        message = Message(Node(senders.pop()), codecs, cycle_ticks, encode, decode)
        self.messages.append(message)
        return message
