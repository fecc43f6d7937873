"""Frames of one member of a local bus, in shared memory: one writer, any number of readers.

Slots are written in turn. A slot is complete when the count of frames includes it: the count is
written after it. The file is read and written by calls and not mapped: a mapped file that another
process truncates would end every process that touches it.
"""

import fcntl
import os
import stat
import struct
import time
from collections import deque
from pathlib import Path

SLOTS = 4096
"""a reader that is farther behind loses frames: about ten seconds of this project's"""
_SLOT = struct.Struct("@QIBB2x64s")
"""stamp in ns, identifier with flags, length, flags of CAN FD, data"""
_HEADER = struct.Struct("@8sQ")
_MAGIC = b"rtc-can2"
_WORD = struct.Struct("@Q")
_COUNT_PLACE = len(_MAGIC)
_SIZE = _HEADER.size + SLOTS * _SLOT.size
_LONGEST_DATA = 64
_MOST_AT_ONCE = 256
"""frames that a reader fetches with one call"""
_FETCHES = 3
"""of slots that the writer overwrites meanwhile"""

Entry = tuple[int, int, int, int, bytes]


class Ring:
    """The writer's end; its file is named after the process."""

    def __init__(self, folder: Path) -> None:
        """Raises OSError if the file cannot be made, or there is no room for it."""
        self.path = folder / f"{os.getpid()}.{time.monotonic_ns()}"
        unfinished = folder.with_name(f".{folder.name}.{self.path.name}")
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
        self._descriptor = os.open(unfinished, flags, 0o600)
        try:
            # Without allocated room a later frame might find none.
            os.posix_fallocate(self._descriptor, 0, _SIZE)
            fcntl.flock(self._descriptor, fcntl.LOCK_EX)  # until this process ends
            os.pwrite(self._descriptor, _HEADER.pack(_MAGIC, 0), 0)
            os.rename(unfinished, self.path)  # others find it from here on
        except OSError:
            os.close(self._descriptor)
            unfinished.unlink(missing_ok=True)
            raise
        self.count = 0
        """frames written so far"""

    def append(
        self, stamp_ns: int, identifier: int, length: int, flags: int, data: bytes | bytearray
    ) -> None:
        """Write one frame; raises OSError if there is no room."""
        place = _HEADER.size + self.count % SLOTS * _SLOT.size
        slot = _SLOT.pack(stamp_ns, identifier, length, flags, data)
        os.pwrite(self._descriptor, slot, place)
        self.count += 1
        os.pwrite(self._descriptor, _WORD.pack(self.count), _COUNT_PLACE)

    def remove(self) -> None:
        """Remove the file; readers that have it open still find the frames that were written."""
        self.path.unlink(missing_ok=True)
        os.close(self._descriptor)


def is_orphaned(path: Path) -> bool:
    """True if the process that wrote this ring has ended, in whatever way.

    Raises:
        OSError: there is no such file.
        ValueError: it is no file, but a pipe, a folder or something else.
    """
    descriptor = _open(path)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    finally:
        os.close(descriptor)
    return True


class RingReader:
    """One reader's end of the ring of another member.

    A ring that was truncated, or whose content makes no sense, is one without new frames.
    """

    def __init__(self, path: Path, from_first: bool) -> None:
        """Read from the first frame on, or only frames written from now on.

        Raises:
            OSError: the file is gone.
            ValueError: the file is not a ring.
        """
        self._descriptor = _open(path)
        count = self._count()
        if count is None:
            os.close(self._descriptor)
            raise ValueError(f"{path} is not a ring of frames")
        self._read = 0 if from_first else count
        """frames that were fetched or skipped"""
        self._fetched: deque[Entry] = deque()

    def has_frames(self) -> bool:
        """True if there is an unread frame."""
        if not self._fetched:
            self._fetch()
        return bool(self._fetched)

    def next_stamp_ns(self) -> int:
        """Time at which the next unread frame was sent; there must be one."""
        return self._fetched[0][0]

    def take(self) -> Entry:
        """The next unread frame; there must be one."""
        return self._fetched.popleft()

    def close(self) -> None:
        os.close(self._descriptor)

    def _count(self) -> int | None:
        """Frames that were written; None if this is no ring, or no longer."""
        header = os.pread(self._descriptor, _HEADER.size, 0)
        if len(header) < _HEADER.size or not header.startswith(_MAGIC):
            return None
        count: int = _HEADER.unpack(header)[1]
        return count

    def _fetch(self) -> None:
        count = self._count()
        if count is None or count == self._read:
            return
        if count < self._read:  # never written so
            self._read = count
            return
        for _ in range(_FETCHES):
            if count - self._read >= SLOTS:
                self._read = count - SLOTS // 2
            first = self._read % SLOTS
            n_slots = min(count - self._read, SLOTS - first, _MOST_AT_ONCE)
            place = _HEADER.size + first * _SLOT.size
            content = os.pread(self._descriptor, n_slots * _SLOT.size, place)
            later = self._count()
            if later is None or len(content) < n_slots * _SLOT.size:
                self._read = count
                return
            if later - self._read < SLOTS:  # not overwritten meanwhile
                self._read += n_slots
                entries = _SLOT.iter_unpack(content)
                self._fetched.extend(entry for entry in entries if entry[2] <= _LONGEST_DATA)
                return
            count = later


def _open(path: Path) -> int:
    """The descriptor of a file; a pipe is not waited for.

    Raises:
        OSError: there is no such file.
        ValueError: it is no file.
    """
    flags = os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOFOLLOW
    descriptor = os.open(path, flags)
    if stat.S_ISREG(os.fstat(descriptor).st_mode):
        return descriptor
    os.close(descriptor)
    raise ValueError(f"{path} is not a ring of frames")
