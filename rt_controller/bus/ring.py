"""Frames of one member of a local bus, in shared memory: one writer, any number of readers.

Slots are written in turn. A slot is complete when the count of frames includes it: the count is
written after it, in one aligned store. On processors that keep the order of stores (x86) a reader
never finds a partly written slot; on others the end-to-end protection of the frames detects it.
"""

import fcntl
import mmap
import os
import struct
import time
from pathlib import Path

SLOTS = 4096
"""a reader that is farther behind loses frames: about ten seconds of this project's"""
_SLOT = struct.Struct("@QIB3x8s")
"""stamp in ns, identifier with flags, length, data"""
_HEADER = struct.Struct("@8sQ")
_MAGIC = b"rtc-can1"
_COUNT = 1
"""place of the count, in words of eight bytes"""
_SIZE = _HEADER.size + SLOTS * _SLOT.size

Entry = tuple[int, int, int, bytes]


class Ring:
    """The writer's end; its file is named after the process."""

    def __init__(self, folder: Path) -> None:
        """Raises OSError if the file cannot be made, or there is no room for it."""
        self.path = folder / f"{os.getpid()}.{time.monotonic_ns()}"
        unfinished = folder.with_name(f".{folder.name}.{self.path.name}")
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
        self._descriptor = os.open(unfinished, flags, 0o600)
        try:
            # Without allocated room the first write to it would end the process.
            os.posix_fallocate(self._descriptor, 0, _SIZE)
            fcntl.flock(self._descriptor, fcntl.LOCK_EX)  # until this process ends
            self._memory = mmap.mmap(self._descriptor, _SIZE)
            _HEADER.pack_into(self._memory, 0, _MAGIC, 0)
            os.rename(unfinished, self.path)  # others find it from here on
        except OSError:
            os.close(self._descriptor)
            unfinished.unlink(missing_ok=True)
            raise
        self._words = memoryview(self._memory).cast("Q")
        self.count = 0
        """frames written so far"""

    def append(self, stamp_ns: int, identifier: int, length: int, data: bytes | bytearray) -> None:
        place = _HEADER.size + self.count % SLOTS * _SLOT.size
        _SLOT.pack_into(self._memory, place, stamp_ns, identifier, length, data)
        self.count += 1
        self._words[_COUNT] = self.count

    def remove(self) -> None:
        """Remove the file; readers that have it open still find the frames that were written."""
        self._words.release()
        self._memory.close()
        self.path.unlink(missing_ok=True)
        os.close(self._descriptor)


def is_orphaned(path: Path) -> bool:
    """True if the process that wrote this ring has ended, in whatever way.

    Raises OSError if there is no such file.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    finally:
        os.close(descriptor)
    return True


class RingReader:
    """One reader's end of the ring of another member."""

    def __init__(self, path: Path, from_first: bool) -> None:
        """Read from the first frame on, or only frames written from now on.

        Raises:
            OSError: the file is gone.
            ValueError: the file is not a ring.
        """
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        try:
            self._memory = mmap.mmap(descriptor, _SIZE, prot=mmap.PROT_READ)
        finally:
            os.close(descriptor)
        if self._memory[: len(_MAGIC)] != _MAGIC:
            self._memory.close()
            raise ValueError(f"{path} is not a ring of frames")
        self._words = memoryview(self._memory).cast("Q")
        self._read = 0 if from_first else self._words[_COUNT]

    def has_frames(self) -> bool:
        return self._words[_COUNT] != self._read

    def next_stamp_ns(self) -> int:
        """Time at which the next unread frame was sent; there must be one."""
        stamp_ns: int = self._entry()[0]
        return stamp_ns

    def take(self) -> Entry:
        """The next unread frame; there must be one."""
        entry = self._entry()
        self._read += 1
        return entry

    def close(self) -> None:
        self._words.release()
        self._memory.close()

    def _entry(self) -> Entry:
        while True:
            if self._words[_COUNT] - self._read >= SLOTS:
                self._read = self._words[_COUNT] - SLOTS // 2
            place = _HEADER.size + self._read % SLOTS * _SLOT.size
            entry: Entry = _SLOT.unpack_from(self._memory, place)
            if self._words[_COUNT] - self._read < SLOTS:  # not overwritten meanwhile
                return entry
