"""A log on disk: a new file, opened without waiting, that takes whole records only.

A log is overwritten only on request: it may be the only record of a drive.
"""

import errno
import os
import stat
import time
from collections.abc import Sequence
from contextlib import suppress
from itertools import accumulate, count
from pathlib import Path

from rt_controller.contract.errors import ConfigError

SUFFIX = ".log"


class LogFile:
    """Records that are appended to a file; a full disk leaves no half of one behind."""

    def __init__(self, path: Path, replaces: bool = False) -> None:
        """Open the file; it is not changed before the first record.

        Args:
            path: of the log. A folder gets a new log that is named after the time.
            replaces: replace the content of an existing file.

        Raises:
            ConfigError: there is a log of that name already, or it cannot be written.
        """
        self.path = _named_after_time(path) if path.is_dir() else path
        self.failure = ""
        """why records are missing, for people; empty if none are"""
        self._descriptor, self._is_new = _open(self.path)
        self._size = 0
        """of the whole records that were written"""
        if os.fstat(self._descriptor).st_size > 0 and not replaces:
            os.close(self._descriptor)
            raise ConfigError(
                f"{self.path}: expected no file of that name yet, found one, which is left as it "
                f"is. Name another file; --overwrite replaces this one."
            )

    def append(self, records: Sequence[bytes]) -> int:
        """Number of records that were written, from the first on; the others are lost."""
        if not records:
            return 0
        rest = memoryview(b"".join(records))
        n_bytes = len(rest)
        try:
            if self._size == 0:
                os.ftruncate(self._descriptor, 0)
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
        except OSError as error:
            self.failure = str(error.strerror)
        whole = [end for end in accumulate(map(len, records)) if end <= n_bytes - len(rest)]
        self._size += whole[-1] if whole else 0
        if len(whole) < len(records):
            with suppress(OSError):
                os.ftruncate(self._descriptor, self._size)
                os.lseek(self._descriptor, self._size, os.SEEK_SET)
        return len(whole)

    def close(self) -> None:
        """Close the file; one that was made for this log and got no record is removed."""
        if self._is_new and self._size == 0:
            self.path.unlink(missing_ok=True)
        try:
            os.close(self._descriptor)
        except OSError as error:  # some file systems write, and fail, only now
            self.failure = str(error.strerror)


def _open(path: Path) -> tuple[int, bool]:
    """The descriptor of a regular file, and whether it was made; a pipe is not waited for."""
    flags = os.O_WRONLY | os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOCTTY
    try:
        try:
            return os.open(path, flags | os.O_CREAT | os.O_EXCL, 0o666), True
        except FileExistsError:
            descriptor = os.open(path, flags)
        if stat.S_ISREG(os.fstat(descriptor).st_mode):
            return descriptor, False
        os.close(descriptor)
        raise OSError(errno.EINVAL, "a device or a pipe")
    except OSError as error:
        raise ConfigError(
            f"{path}: expected a file that the log of the bus can be written to, found "
            f"{error.strerror}. Name another file, in a folder that exists."
        ) from error


def _named_after_time(folder: Path) -> Path:
    name = time.strftime("%Y%m%d-%H%M%S")
    paths = (folder / f"{name}{f'-{n}' if n > 1 else ''}{SUFFIX}" for n in count(1))
    return next(path for path in paths if not path.exists())
