"""Recorder of a drive: frames to a candump log, and what the loop did with them to a journal.

The journal is one line of JSON for each tick; `recording.journal` says what is in it and reads it.

The loop only appends to a bounded queue; a separate thread writes and closes the files. Frames that
do not fit are dropped and counted, and so are those that the disk does not take. In lockstep the
drive waits for room in the queue, so the same drive gives the same bytes.

The lines are made here: python-can's CanutilsLogWriter appends the direction to every line, rounds
stamps through floats, and replaces the class of error frames.
"""

import json
import threading
import time
from collections import deque
from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, NamedTuple

import can

from rt_controller.bus.log.log_file import SUFFIX, LogFile
from rt_controller.contract.errors import ConfigError

QUEUE_FRAMES = 65_536
"""three minutes of this project's frames, in case the disk blocks for that long"""
JOURNAL_SUFFIX = ".journal"
RECEIVED, SENT = "received", "sent"
ERROR_FLAG = 0x2000_0000
"""of an identifier in a candump log"""
_WRITE_INTERVAL_S = 0.2
_FRAMES_PER_WRITE = 512
LONGEST_CLOSE_S = 2.0
"""for what is left at the end; later the log counts as incomplete"""


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

    @property
    def line(self) -> str:
        """Identifier and data as `candump -L` writes them."""
        identifier, data = self.identifier, self.data.hex().upper()
        if self.is_error:
            return f"{identifier | ERROR_FLAG:08X}#{data}"
        digits = f"{identifier:0{8 if self.is_extended else 3}X}"
        return f"{digits}#{'R' if self.is_remote else '#0' if self.is_fd else ''}{data}"


_Entry = RecordedFrame | str | Mapping[str, Any]
"""a frame, the name of a call of the loop, or the line of a tick"""


class _Journal:
    """The file beside a log that says before which tick its frames were read or sent."""

    def __init__(self, log: Path, header: Mapping[str, Any], replaces: bool) -> None:
        self.file = LogFile(journal_path(log), replaces)
        self._lines = [_json_line(header)]
        """not yet written"""
        self._calls: list[list[str | int]] = []
        """since the last tick"""

    def append(self, entries: list[_Entry], n_logged: int) -> None:
        """Take frames, calls and ticks; the log took the first `n_logged` of the frames."""
        for entry in entries:
            if isinstance(entry, RecordedFrame):
                n_logged -= 1
                # The step uses frames with data only, and some formats reorder the others.
                if n_logged >= 0 and not (entry.is_remote or entry.is_error):
                    self._add_frame(entry)
            elif isinstance(entry, str):
                self._calls.append([entry])
            else:
                self._lines.append(_json_line({**entry, "calls": self._calls}))
                self._calls = []
        self.file.append(self._lines)
        self._lines = []

    def _add_frame(self, frame: RecordedFrame) -> None:
        name = SENT if frame.is_sent else RECEIVED
        last = self._calls[-1] if self._calls else []
        if last[:2] == [name, frame.stamp_ns]:
            last[2] = int(last[2]) + 1
        else:
            self._calls.append([name, frame.stamp_ns, 1])

    def close(self) -> None:
        if self._calls:
            self.file.append([_json_line({"tick": -1, "calls": self._calls})])
        self.file.close()


def journal_path(log: Path) -> Path:
    """The journal of a log."""
    return log.with_name(log.name + JOURNAL_SUFFIX)


def _json_line(content: Mapping[str, Any]) -> bytes:
    return json.dumps(content, separators=(",", ":"), default=str).encode() + b"\n"


class Recorder(AbstractContextManager["Recorder"]):
    """A log that is being written, and its journal; the end of the context closes them."""

    def __init__(
        self,
        path: Path,
        channel: str,
        *,
        is_lockstep: bool,
        capacity: int = QUEUE_FRAMES,
        replaces: bool = False,
        journal: Mapping[str, Any] | None = None,
    ) -> None:
        """Open the files.

        Args:
            path: of the log, or a folder, as `LogFile`.
            channel: name of the bus.
            is_lockstep: `record` waits for the disk, and the log has simulated instead of calendar
                time: the same run gives the same bytes.
            capacity: of the queue, in frames and events.
            replaces: replace existing files.
            journal: first line of the journal; None: without one.

        Raises:
            ConfigError: a file cannot be written, or exists already, or its suffix is that of
                another format.
        """
        self.written = 0
        self._taken = self._overflowed = self._unwritable = 0
        self._capacity, self._is_lockstep = capacity, is_lockstep
        self._channel = "_".join(channel.split()) or "can"
        self._epoch_offset_ns = 0 if is_lockstep else time.time_ns() - time.monotonic_ns()
        self._log = _open_log(path, replaces)
        self._journal: _Journal | None = None
        try:
            if journal is not None:
                self._journal = _Journal(self._log.path, journal, replaces)
        except BaseException:
            self._log.close()
            raise
        self._files = [self._log, *(() if self._journal is None else (self._journal.file,))]
        self._is_closed = self._is_explained = self._is_given_up = False
        self._queue: deque[_Entry] = deque()
        self._is_closing = threading.Event()
        self._writer = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._writer.start()

    @property
    def path(self) -> Path:
        """The log that is written."""
        return self._log.path

    @property
    def dropped(self) -> int:
        """Frames that are missing in the log because the queue or the disk was full."""
        return self._overflowed + self._unwritable

    @property
    def last_failure(self) -> str:
        """Why frames are missing, for people; empty if none are."""
        overflow = "a disk that is too slow" if self._overflowed else ""
        return next((each.failure for each in self._files if each.failure), overflow)

    def explain_failure(self) -> str:
        """The message about a file that is incomplete; empty if none is."""
        if not self.last_failure:
            return ""
        failed = [each.path for each in self._files if each.failure] or [self._files[0].path]
        missing = (
            f"{self.dropped} frames are missing in the log" if self.dropped else "it ends early"
        )
        return (
            f"{failed[0]}: expected room for the log of the bus, found {self.last_failure}: "
            f"{missing}. Free some space, or name another file."
        )

    def new_failure(self) -> str:
        """The same message at the first call after frames were lost, otherwise empty."""
        failure = "" if self._is_explained else self.explain_failure()
        self._is_explained = bool(failure) or self._is_explained
        return failure

    def record(self, message: can.Message, timestamp_ns: int, is_sent: bool = False) -> None:
        """Keep a copy of this frame; the message may be changed afterwards."""
        if not self._has_room():
            self._overflowed += 1
            return
        self._taken += 1
        self._queue.append(
            RecordedFrame(
                timestamp_ns,
                is_sent,
                message.arbitration_id,
                message.is_extended_id,
                message.is_remote_frame,
                message.is_error_frame,
                message.is_fd,
                bytes(message.data),
            )
        )

    def record_event(self, event: str | Mapping[str, Any]) -> None:
        """Keep a call or a tick for the journal, not changed any more; none in a full queue."""
        if self._journal is not None and self._has_room():
            self._queue.append(event)

    def close(self) -> None:
        """Write what is left and close the files; what a stalled disk does not take is lost."""
        if self._is_closed:
            return
        self._is_closed = True
        self._is_closing.set()
        self._writer.join(LONGEST_CLOSE_S)
        if self._writer.is_alive():
            self._is_given_up = True
            self._overflowed = self._taken + self._overflowed - self.written - self._unwritable

    def __exit__(self, *_: object) -> None:
        self.close()

    def _has_room(self) -> bool:
        """True if the queue has room; in lockstep the disk is waited for."""
        while len(self._queue) >= self._capacity:
            if not self._is_lockstep:
                return False
            time.sleep(1e-3)
        return True

    def _run(self) -> None:
        while not self._is_closing.wait(_WRITE_INTERVAL_S):
            self._write_queue()
        self._write_queue()
        self._log.close()
        if self._journal is not None:
            self._journal.close()

    def _write_queue(self) -> None:
        # A full disk must end neither the drive nor this thread.
        while self._queue and not self._is_given_up:
            n_entries = min(len(self._queue), _FRAMES_PER_WRITE)
            entries = [self._queue.popleft() for _ in range(n_entries)]
            lines = [self._line(each) for each in entries if isinstance(each, RecordedFrame)]
            n_written = self._log.append(lines)
            if self._is_given_up:
                return
            self.written += n_written
            self._unwritable += len(lines) - n_written
            if self._journal is not None:
                self._journal.append(entries, n_written)

    def _line(self, frame: RecordedFrame) -> bytes:
        seconds, rest_ns = divmod(frame.stamp_ns + self._epoch_offset_ns, 1_000_000_000)
        return f"({seconds}.{rest_ns // 1000:06d}) {self._channel} {frame.line}\n".encode()


def log_to_json(recorder: Recorder | None) -> dict[str, Any]:
    """The figures of a log; its name is null without one, and its failure if it is complete."""
    return {
        "log_file": None if recorder is None else str(recorder.path),
        "log_frames_written": 0 if recorder is None else recorder.written,
        "log_frames_dropped": 0 if recorder is None else recorder.dropped,
        "log_failure": (recorder and recorder.last_failure) or None,
    }


def require_recordable(path: Path | None, replaces: bool = False) -> None:
    """Return if a log can be recorded there, or None is given; an existing log is left as it is."""
    if path is not None:
        _open_log(path, replaces).close()


def _open_log(path: Path, replaces: bool) -> LogFile:
    if path.suffix.lower() != SUFFIX and not path.is_dir():
        raise ConfigError(
            f"{path}: expected a candump log with the suffix {SUFFIX}, or a folder that exists, "
            f"found neither. Record a {SUFFIX}; can_logconvert, or rt-controller replay --mcap, "
            f"makes the other formats of it."
        )
    return LogFile(path, replaces)
