"""The file that foxglove-sdk writes MCAP to.

Given a path, the package would print a failed write and go on, so that a full disk would be found
at the end of the drive only. It writes through this object instead, which keeps the failure; and
Python releases the interpreter lock while the disk takes its time.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from rt_controller.bus.log.log_file import LogFile

if TYPE_CHECKING:
    from foxglove import Context
    from foxglove.mcap import MCAPWriter

_CHUNK_BYTES = 1 << 16
"""of uncompressed messages; a killed program loses what it has not written"""


class McapFile:
    """A file without seeking, to be written by one `MCAPWriter`."""

    def __init__(self, path: Path, replaces: bool = False) -> None:
        """Open the file, as `LogFile`.

        Raises:
            ConfigError: it cannot be written, or exists already and `replaces` is False.
        """
        self._file = LogFile(path, replaces)
        self._size = 0

    @property
    def failure(self) -> str:
        """Why the file is incomplete, for people; empty if it is not."""
        return self._file.failure

    def writer(self, context: "Context") -> "MCAPWriter":
        """Writes to this file what is logged in a context of foxglove-sdk."""
        from foxglove import open_mcap
        from foxglove.mcap import MCAPWriteOptions

        options = MCAPWriteOptions(chunk_size=_CHUNK_BYTES, disable_seeking=True)
        return open_mcap(self, context=context, writer_options=options)

    def write(self, data: bytes | bytearray) -> int:
        """Number of bytes: all. After a write that failed, nothing more is written.

        An exception would be printed by the package for each further message.
        """
        if not self.failure:
            self._file.append([bytes(data)])
        self._size += len(data)
        return len(data)

    def seek(self, offset: int, whence: int = 0) -> int:
        """The position, which cannot be changed."""
        return self._size

    def flush(self) -> None:
        """Every write has been passed on already."""

    def close(self) -> None:
        """Close the file; an empty one that was made here is removed."""
        self._file.close()
