"""The log of a drive: every frame as `candump -L` writes it, readable by python-can and SavvyCAN.

In real time the loop only appends frames to a bounded queue; a separate thread writes them. Frames
that do not fit are dropped and counted. In lockstep frames are written at once and stamps come
from the caller, so the same drive gives the same bytes.

python-can's CanutilsLogWriter is not used: it appends the direction to every line, rounds stamps
through floats, and replaces the class of error frames.
"""

import threading
import time
from collections import deque
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TextIO

import can

from rt_controller.contract.errors import ConfigError

QUEUE_FRAMES = 65_536
"""three minutes of this project's frames, in case the disk blocks for that long"""
_OTHER_FORMATS = (".asc", ".blf", ".mf4", ".trc", ".csv", ".db")
"""formats that python-can converts a candump log into"""
_WRITE_INTERVAL_S = 0.2
_Kind = tuple[int, bool, bool, bool, bool]
"""id, is extended, is remote, is error, is CAN FD"""


class Recorder(AbstractContextManager["Recorder"]):
    """A candump log that is being written; the end of the context closes it."""

    def __init__(
        self,
        path: Path,
        channel: str,
        *,
        is_threaded: bool,
        capacity: int = QUEUE_FRAMES,
        epoch_offset_ns: int = 0,
    ) -> None:
        """Open the log.

        Args:
            path: of the log; replaced if it exists.
            channel: name of the bus in every line.
            is_threaded: a thread writes (real time), or `record` itself (lockstep).
            capacity: of the queue, in frames.
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
        self._queue: deque[tuple[int, _Kind, bytes]] = deque()
        """stamp in ns, kind of frame, data"""
        self._is_closing = threading.Event()
        self._writer: threading.Thread | None = None
        if is_threaded:
            self._writer = threading.Thread(target=self._run, name="recorder", daemon=True)
            self._writer.start()

    @property
    def dropped(self) -> int:
        """Frames that are missing in the log because the queue or the disk was full."""
        return self._overflowed + self._unwritable

    def record(self, message: can.Message, timestamp_ns: int) -> None:
        """Keep a copy of this frame; the message may be changed afterwards."""
        if len(self._queue) >= self._capacity:
            self._overflowed += 1
            return
        kind = (
            message.arbitration_id,
            message.is_extended_id,
            message.is_remote_frame,
            message.is_error_frame,
            message.is_fd,
        )
        self._queue.append((timestamp_ns, kind, bytes(message.data)))
        if self._writer is None:
            self._write_queue()

    def close(self) -> None:
        """Write what is left and close the file."""
        if self._file.closed:
            return
        if self._writer is not None:
            self._is_closing.set()
            self._writer.join()
        self._write_queue()
        try:
            self._file.close()
        except OSError as error:
            self.last_failure = str(error)

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        while not self._is_closing.wait(_WRITE_INTERVAL_S):
            self._write_queue()
            try:
                self._file.flush()
            except OSError as error:
                self.last_failure = str(error)

    def _write_queue(self) -> None:
        # A full disk must end neither the drive nor this thread.
        while self._queue:
            timestamp_ns, kind, data = self._queue.popleft()
            seconds, rest_ns = divmod(timestamp_ns + self._epoch_offset_ns, 1_000_000_000)
            stamp = f"({seconds}.{rest_ns // 1000:06d})"
            content = f"{_identifier(*kind)}{data.hex().upper()}"
            try:
                self._file.write(f"{stamp} {self._channel} {content}\n")
                self.written += 1
            except OSError as error:
                self._unwritable += 1
                self.last_failure = str(error)


def open_recorder(path: Path | None, channel: str, is_lockstep: bool = False) -> Recorder | None:
    """A recorder with calendar time in its stamps; None if no file is named.

    Raises:
        ConfigError: the file cannot be written.
    """
    if path is None:
        return None
    # In lockstep the stamps are simulated time: the same run gives the same bytes.
    offset_ns = 0 if is_lockstep else time.time_ns() - time.monotonic_ns()
    return Recorder(path, channel, is_threaded=not is_lockstep, epoch_offset_ns=offset_ns)


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


def _identifier(
    number: int, is_extended: bool, is_remote: bool, is_error: bool, is_fd: bool
) -> str:
    """The id in candump's form, with what stands between it and the data."""
    if is_error:
        return f"{number | 0x2000_0000:08X}#"
    digits = f"{number:0{8 if is_extended else 3}X}"
    if is_remote:
        return f"{digits}#R"
    return f"{digits}##0" if is_fd else f"{digits}#"
