"""Formats of the frames of a drive: candump here; BLF, ASC and MF4 by python-can's writers.

The candump log is written here: python-can's CanutilsLogWriter appends the direction to every line,
rounds stamps through floats, and replaces the class of error frames.
"""

import importlib
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

import can
from can.io.generic import MessageWriter

from rt_controller.bus.log.log_file import LogFile
from rt_controller.contract.errors import ConfigError, needs_extra

_PYTHON_CAN_SUFFIXES = (".asc", ".blf", ".mf4")
_OTHER_SUFFIXES = (".trc", ".csv", ".db")
"""formats that python-can converts a candump log into"""
LONGEST_CLOSE_S = 2.0
_LONGEST_MF4_S = 30.0
"""all of it is written at the end: 0.7 s of computing for 10 minutes"""


class RecordedFrame(NamedTuple):
    """A copy of one frame as it was received or sent."""

    stamp_ns: int
    """on the clock of the loop"""
    is_sent: bool
    """True if it was sent by the program that records"""
    identifier: int
    is_extended: bool
    is_remote: bool
    is_error: bool
    is_fd: bool
    data: bytes


class FrameLog(Protocol):
    """A file of frames; all calls come from one thread at a time."""

    @property
    def path(self) -> Path:
        """The file that is written."""

    @property
    def failure(self) -> str:
        """Why frames are missing, for people; empty if none are."""

    @property
    def longest_close_s(self) -> float:
        """Longest wait for this file at the end of a drive; later it counts as incomplete."""

    def append(self, frames: Sequence[RecordedFrame]) -> int:
        """Number of frames that were written, from the first on; the others are lost."""

    def close(self) -> int:
        """Complete the file; the number of frames that were counted as written, but are lost."""


def open_frame_log(
    path: Path, channel: str, epoch_offset_ns: int = 0, replaces: bool = False
) -> FrameLog:
    """A log of the format that the suffix names.

    Args:
        path: .log (candump), .blf, .asc or .mf4; without a suffix candump. Also as `LogFile`.
        channel: name of the bus.
        epoch_offset_ns: added to every stamp, to turn monotonic into calendar time.
        replaces: replace an existing log.

    Raises:
        ConfigError: the file cannot be written, exists already, or the format is another one.
        MissingExtraError: .mf4, and asammdf is not installed.
    """
    suffix = path.suffix.lower()
    if suffix in _OTHER_SUFFIXES:
        raise ConfigError(
            f"{path}: expected a candump log (.log) or {', '.join(_PYTHON_CAN_SUFFIXES)}, found "
            f"the suffix of another format. Record a .log and convert it: "
            f"python -m can.logconvert drive.log drive{suffix}"
        )
    if suffix == ".mcap":
        raise ConfigError(
            f"{path}: expected a log of frames, found the suffix of MCAP, which has decoded "
            f"signals. Name the MCAP file with --mcap; --record may name a .log beside it."
        )
    kind = PythonCanLog if suffix in _PYTHON_CAN_SUFFIXES and not path.is_dir() else CandumpLog
    return kind(path, channel, epoch_offset_ns, replaces)


class CandumpLog:
    """Lines as `candump -L` writes them."""

    def __init__(
        self, path: Path, channel: str, epoch_offset_ns: int = 0, replaces: bool = False
    ) -> None:
        """As `open_frame_log`."""
        self._channel = "_".join(channel.split()) or "can"
        self._epoch_offset_ns = epoch_offset_ns
        self._file = LogFile(path, replaces)

    @property
    def path(self) -> Path:
        return self._file.path

    @property
    def failure(self) -> str:
        return self._file.failure

    @property
    def longest_close_s(self) -> float:
        return LONGEST_CLOSE_S

    def append(self, frames: Sequence[RecordedFrame]) -> int:
        return self._file.append([self._line(frame) for frame in frames])

    def close(self) -> int:
        self._file.close()
        return 0

    def _line(self, frame: RecordedFrame) -> bytes:
        seconds, rest_ns = divmod(frame.stamp_ns + self._epoch_offset_ns, 1_000_000_000)
        stamp = f"({seconds}.{rest_ns // 1000:06d})"
        content = f"{_candump_identifier(frame)}{frame.data.hex().upper()}"
        return f"{stamp} {self._channel} {content}\n".encode()


class PythonCanLog:
    """A log that python-can's writer of the suffix writes; parts of it when it is closed.

    BLF is written in blocks. MF4 is kept in a temporary file until the end: the log of a killed
    program is empty. Where the file cannot be completed, all its frames count as lost.
    """

    def __init__(
        self, path: Path, channel: str, epoch_offset_ns: int = 0, replaces: bool = False
    ) -> None:
        """As `open_frame_log`."""
        self.path, self.failure, self.longest_close_s = path, "", LONGEST_CLOSE_S
        self._channel = channel
        self._epoch_offset_ns = epoch_offset_ns
        self._lock = LogFile(path, replaces)
        self._writer: MessageWriter | None = None
        self._n_taken = 0
        if path.suffix.lower() == ".mf4":
            use_asammdf(path)
            self.longest_close_s = _LONGEST_MF4_S

    def append(self, frames: Sequence[RecordedFrame]) -> int:
        for number, frame in enumerate(frames):
            try:
                if self._writer is None:
                    self._writer = can.Logger(self.path)
                self._writer.on_message_received(self._message(frame))
                self._n_taken += 1
            except Exception as error:  # each format raises its own types
                self.failure = str(error)
                return number
        return len(frames)

    def close(self) -> int:
        self._lock.close(removes_unused=self._writer is None)
        try:
            if self._writer is not None:
                self._writer.stop()
        except Exception as error:
            self.failure = str(error)
            return self._n_taken
        return 0

    def _message(self, frame: RecordedFrame) -> can.Message:
        return can.Message(
            timestamp=(frame.stamp_ns + self._epoch_offset_ns) * 1e-9,
            arbitration_id=frame.identifier,
            is_extended_id=frame.is_extended,
            is_remote_frame=frame.is_remote,
            is_error_frame=frame.is_error,
            is_fd=frame.is_fd,
            is_rx=not frame.is_sent,
            data=None if frame.is_remote else frame.data,
            channel=self._channel,
        )


def use_asammdf(path: Path) -> None:
    """Give python-can asammdf, which `rt_controller.bus` hides from it for a fast start.

    Raises:
        MissingExtraError: asammdf is not installed.
    """
    from can.io import mf4

    with needs_extra("record", f"{path}: a log in MF4"):
        import asammdf  # noqa: F401
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)  # it would print what it raises
    if getattr(mf4, "asammdf", None) is None:
        importlib.reload(mf4)  # the names in it are bound again, also those that its classes use


def _candump_identifier(frame: RecordedFrame) -> str:
    """The id in candump's form, with what stands between it and the data."""
    if frame.is_error:
        return f"{frame.identifier | 0x2000_0000:08X}#"
    digits = f"{frame.identifier:0{8 if frame.is_extended else 3}X}"
    if frame.is_remote:
        return f"{digits}#R"
    return f"{digits}##0" if frame.is_fd else f"{digits}#"
