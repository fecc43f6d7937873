"""The frames of a drive as a candump log, which python-can converts into other formats.

It is written here: python-can's CanutilsLogWriter appends the direction to every line, rounds
stamps through floats, and replaces the class of error frames.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from rt_controller.bus.log.log_file import LogFile
from rt_controller.contract.errors import ConfigError

_OTHER_SUFFIXES = (".asc", ".blf", ".mf4", ".trc", ".csv", ".db")
"""formats that python-can converts a candump log into"""


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


class CandumpLog:
    """Lines as `candump -L` writes them."""

    def __init__(
        self, path: Path, channel: str, epoch_offset_ns: int = 0, replaces: bool = False
    ) -> None:
        """Open the log.

        Args:
            path: of the file, or a folder, as `LogFile`.
            channel: name of the bus.
            epoch_offset_ns: added to every stamp, to turn monotonic into calendar time.
            replaces: replace an existing log.

        Raises:
            ConfigError: the file cannot be written, exists already, or its suffix is that of
                another format.
        """
        _require_candump_suffix(path)
        self._channel = "_".join(channel.split()) or "can"
        self._epoch_offset_ns = epoch_offset_ns
        self._file = LogFile(path, replaces)

    @property
    def path(self) -> Path:
        """The file that is written."""
        return self._file.path

    @property
    def failure(self) -> str:
        """Why frames are missing, for people; empty if none are."""
        return self._file.failure

    def append(self, frames: Sequence[RecordedFrame]) -> int:
        """Number of frames that were written, from the first on; the others are lost."""
        return self._file.append([self._line(frame) for frame in frames])

    def close(self) -> None:
        """Complete the file."""
        self._file.close()

    def _line(self, frame: RecordedFrame) -> bytes:
        seconds, rest_ns = divmod(frame.stamp_ns + self._epoch_offset_ns, 1_000_000_000)
        stamp = f"({seconds}.{rest_ns // 1000:06d})"
        content = f"{_candump_identifier(frame)}{frame.data.hex().upper()}"
        return f"{stamp} {self._channel} {content}\n".encode()


def _require_candump_suffix(path: Path) -> None:
    suffix = path.suffix.lower()
    if suffix in _OTHER_SUFFIXES and not path.is_dir():
        raise ConfigError(
            f"{path}: expected a candump log (.log), found the suffix of another format. Record a "
            f".log and convert it: can_logconvert drive.log drive{suffix}"
        )
    if suffix == ".mcap":
        raise ConfigError(
            f"{path}: expected a log of frames, found the suffix of MCAP, which has decoded "
            f"signals. Name the MCAP file with --mcap; --record may name a .log beside it."
        )


def _candump_identifier(frame: RecordedFrame) -> str:
    """The id in candump's form, with what stands between it and the data."""
    if frame.is_error:
        return f"{frame.identifier | 0x2000_0000:08X}#"
    digits = f"{frame.identifier:0{8 if frame.is_extended else 3}X}"
    if frame.is_remote:
        return f"{digits}#R"
    return f"{digits}##0" if frame.is_fd else f"{digits}#"
