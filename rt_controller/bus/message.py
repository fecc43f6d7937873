"""What a message is: one content of the program, carried by one or more CAN frames.

A new message needs its frames in `messages.dbc`, its frame in `messages_fd.dbc`, one
`Catalogue.define` in `catalogue.py`, and one call: `Outbox.send(MESSAGE, content, now_ns)` or
`Inbox.newest(MESSAGE)`.
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
        fd_codecs: tuple[FrameCodec, ...],
        cycle_ticks: int,
        encode: Callable[[T], tuple[float, ...]],
        decode: Callable[..., T],
    ) -> None:
        self.sender = sender
        self.codecs = codecs
        """of classic CAN"""
        self.fd_codecs = fd_codecs
        """of CAN FD, where the content is in one frame"""
        self.cycle_ticks = cycle_ticks
        self._encode = encode
        self._decode = decode
        ends = accumulate(codec.n_values for codec in codecs)
        self._parts = tuple(
            (codec, slice(end - codec.n_values, end))
            for codec, end in zip(codecs, ends, strict=True)
        )

    def codecs_of(self, is_fd: bool) -> tuple[FrameCodec, ...]:
        """Those of CAN FD, or of classic CAN."""
        return self.fd_codecs if is_fd else self.codecs

    @property
    def cycle_ms(self) -> float:
        return self.cycle_ticks * PERIOD_MS

    def encode(
        self, content: T, counter: int, is_valid: bool = True, is_fd: bool = False
    ) -> list[bytes]:
        """One protected frame for each codec, all with this counter."""
        values = self._encode(content)
        if is_fd or len(self.codecs) == 1:
            return [codec.write(values, counter, is_valid) for codec in self.codecs_of(is_fd)]
        return [codec.write(values[part], counter, is_valid) for codec, part in self._parts]

    def decode(self, parts: Iterable[tuple[float, ...]]) -> T:
        """The content of what `FrameCodec.read` returned for each frame."""
        return self._decode(*chain.from_iterable(parts))


class Catalogue:
    """All messages of one bus, in the order of their definitions."""

    def __init__(self, path: Path, fd_path: Path | None = None) -> None:
        """Read the DBC of the frames of classic CAN, and that of CAN FD; None: without those."""
        self._dbc = read_dbc(path)
        self._fd_dbc = None if fd_path is None else read_dbc(fd_path)
        self.messages: list[Message[Any]] = []

    def define(
        self,
        *frames: FrameSpec,
        fd_name: str | None = None,
        cycle_ticks: int,
        encode: Callable[[T], tuple[float, ...]],
        decode: Callable[..., T],
    ) -> Message[T]:
        """A message of the catalogue; its sender and the layout of its frames come from the DBC.

        Args:
            frames: the frames that carry it, in the order of the values.
            fd_name: of the frame of CAN FD that has all their signals; default: as the first frame.
            cycle_ticks: control periods from one sending to the next.
            encode: physical values of all frames, flat, from the content; a flag other than
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
        fd_codecs: tuple[FrameCodec, ...] = ()
        if self._fd_dbc is not None:
            fd_codecs = (FrameCodec(self._fd_dbc, _joined(frames, fd_name)),)
        message = Message(Node(senders.pop()), codecs, fd_codecs, cycle_ticks, encode, decode)
        self.messages.append(message)
        return message


def _joined(frames: tuple[FrameSpec, ...], name: str | None) -> FrameSpec:
    """One frame with the signals of all."""
    return FrameSpec(
        name or frames[0].name,
        frames[0].flag,
        tuple(chain.from_iterable(frame.signals for frame in frames)),
        tuple(chain.from_iterable(frame.optional for frame in frames)),
    )
