"""The log of a drive: every frame in the format of candump, readable by python-can and SavvyCAN.

In real time the loop only drops frames into a bounded ring; a thread of its own writes them. What
does not fit is dropped and counted. In lockstep frames are written at once and stamps come from
the caller, so the same drive gives the same bytes.
"""

import threading
from collections import deque
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self, TextIO

import can

from rt_controller.contract.errors import ConfigError

RING_FRAMES = 65_536
"""Two minutes of this project's frames, should the disk stall for so long."""
_OTHER_FORMATS = (".asc", ".blf", ".mf4", ".trc", ".csv", ".db")
"""which python-can converts a candump log into, and which this would not be"""
_WRITE_INTERVAL_S = 0.2

# The flags that SocketCAN keeps above the 29 bits of an id.
_EXTENDED_FLAG = 0x8000_0000
_REMOTE_FLAG = 0x4000_0000
_ERROR_FLAG = 0x2000_0000

_Entry = tuple[int, int, str, bytes]
"""stamp in ns, id with flags, separator, data"""


class FrameSink(Protocol):
    """Takes a copy of every frame that was read or sent."""

    def record(self, message: can.Message, timestamp_ns: int) -> None: ...


class Recorder:
    """A candump log being written. Close it, or use it as a context manager."""

    def __init__(
        self,
        path: Path,
        channel: str,
        *,
        is_threaded: bool,
        capacity: int = RING_FRAMES,
        epoch_offset_ns: int = 0,
    ) -> None:
        """Open the log.

        Args:
            path: of the log; replaced if it exists.
            channel: name of the bus in every line.
            is_threaded: a thread writes (real time), or `record` itself (lockstep).
            capacity: of the ring, in frames.
            epoch_offset_ns: added to every stamp, to turn monotonic into calendar time.

        Raises:
            ConfigError: the file cannot be written.
        """
        self.written = 0
        self.last_failure = ""
        self._overflowed = 0
        self._unwritable = 0
        self._channel = "_".join(channel.split()) or "can"
        self._capacity = capacity
        self._epoch_offset_ns = epoch_offset_ns
        self._file = _open(path)
        self._ring: deque[_Entry] = deque()
        self._is_closing = threading.Event()
        self._writer: threading.Thread | None = None
        if is_threaded:
            self._writer = threading.Thread(target=self._write_on, name="recorder", daemon=True)
            self._writer.start()

    @property
    def dropped(self) -> int:
        """Frames that are missing in the log: the ring was full, or the disk."""
        return self._overflowed + self._unwritable

    def record(self, message: can.Message, timestamp_ns: int) -> None:
        """Keep a copy of this frame; the message may be changed afterwards."""
        if len(self._ring) >= self._capacity:
            self._overflowed += 1
            return
        separator = "##0" if message.is_fd else "#"
        entry = (timestamp_ns, _flagged_id(message), separator, bytes(message.data))
        self._ring.append(entry)
        if self._writer is None:
            self._write_ring()

    def close(self) -> None:
        """Write what is left and close the file."""
        if self._file.closed:
            return
        if self._writer is not None:
            self._is_closing.set()
            self._writer.join()
        self._write_ring()
        try:
            self._file.close()
        except OSError as error:
            self.last_failure = str(error)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def _write_on(self) -> None:
        while not self._is_closing.wait(_WRITE_INTERVAL_S):
            self._write_ring()
            self._flush()

    def _write_ring(self) -> None:
        # A full disk must not end the drive, nor this thread.
        while self._ring:
            entry = self._ring.popleft()
            try:
                self._file.write(_line(entry, self._channel, self._epoch_offset_ns))
                self.written += 1
            except OSError as error:
                self._unwritable += 1
                self.last_failure = str(error)

    def _flush(self) -> None:
        try:
            self._file.flush()
        except OSError as error:
            self.last_failure = str(error)


def _open(path: Path) -> TextIO:
    if path.suffix.lower() in _OTHER_FORMATS:
        raise ConfigError(
            f"{path}: expected a candump log (.log), found the suffix of another format. Record "
            f"a .log and convert it: python -m can.logconvert drive.log drive{path.suffix}"
        )
    try:
        return path.open("w", encoding="utf-8", newline="\n")
    except OSError as error:
        raise ConfigError(
            f"{path}: expected a file that the log of the bus can be written to, found "
            f"{error.strerror}. Name another file, in a folder that exists."
        ) from error


def _flagged_id(message: can.Message) -> int:
    flagged_id = message.arbitration_id
    if message.is_error_frame:
        return flagged_id | _ERROR_FLAG
    if message.is_extended_id:
        flagged_id |= _EXTENDED_FLAG
    if message.is_remote_frame:
        flagged_id |= _REMOTE_FLAG
    return flagged_id


def _line(entry: _Entry, channel: str, epoch_offset_ns: int) -> str:
    timestamp_ns, flagged_id, separator, data = entry
    seconds, rest_ns = divmod(timestamp_ns + epoch_offset_ns, 1_000_000_000)
    is_long = flagged_id & (_EXTENDED_FLAG | _ERROR_FLAG)
    shown_id = flagged_id & ~(_EXTENDED_FLAG | _REMOTE_FLAG)
    digits = f"{shown_id:08X}" if is_long else f"{shown_id:03X}"
    content = "R" if flagged_id & _REMOTE_FLAG else data.hex().upper()
    return f"({seconds}.{rest_ns // 1000:06d}) {channel} {digits}{separator}{content}\n"
