"""Standard output and error that never raise: what cannot be written is discarded and reported.

A drive must not end because the pipe or the disk of its output is gone.
"""

import io
import select
import sys
from typing import TextIO

LONGEST_WAIT_S = 1.0
"""for which a line of progress waits for a reader that has stopped reading"""


class LossyFile(io.FileIO):
    """An open descriptor that discards what cannot be written."""

    def __init__(self, descriptor: int, longest_wait_s: float | None = None) -> None:
        """`longest_wait_s` limits the wait for a reader that does not read; None: no limit."""
        super().__init__(descriptor, "w", closefd=False)
        self.failure = ""
        """why something is missing, for people; empty if nothing is"""
        self._longest_wait_s = longest_wait_s

    def write(self, data: object) -> int:
        """Write what can be written; the number of bytes is always that of all data."""
        view = memoryview(data).cast("B")  # type: ignore[arg-type]
        rest = view
        try:
            while rest:
                if self._longest_wait_s is not None and not self._is_ready(self._longest_wait_s):
                    raise BlockingIOError(0, "a reader that does not read")
                rest = rest[super().write(rest[: select.PIPE_BUF]) or 0 :]
        except OSError as error:
            self.failure = error.strerror or str(error)
        return len(view)

    def _is_ready(self, longest_wait_s: float) -> bool:
        """True if a write will not block; after a failure nothing is waited for."""
        waiting = select.poll()
        waiting.register(self.fileno(), select.POLLOUT)
        return bool(waiting.poll(0.0 if self.failure else 1e3 * longest_wait_s))


def protect_streams() -> None:
    """Make stdout and stderr of this process lossy; others that replace them are left alone."""
    if sys.__stdout__ is not None and sys.stdout is sys.__stdout__:
        sys.stdout = _lossy(sys.__stdout__, 1, None)
    if sys.__stderr__ is not None and sys.stderr is sys.__stderr__:
        sys.stderr = _lossy(sys.__stderr__, 2, LONGEST_WAIT_S)


def lost_output() -> dict[str, str]:
    """Why output is missing, by the name of the stream; flushes both."""
    failures = {}
    for name, stream in (("stdout", sys.stdout), ("stderr", sys.stderr)):
        raw = getattr(getattr(stream, "buffer", None), "raw", None)
        if isinstance(raw, LossyFile):
            stream.flush()
            if raw.failure:
                failures[name] = raw.failure
    return failures


def _lossy(stream: TextIO, descriptor: int, longest_wait_s: float | None) -> TextIO:
    raw = LossyFile(descriptor, longest_wait_s)
    return io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=stream.encoding,
        errors="backslashreplace",
        line_buffering=raw.isatty() or descriptor == 2,
    )
