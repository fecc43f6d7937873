"""Standard output and error that never raise: what cannot be written is discarded and reported.

A drive must not end because the pipe, the terminal or the disk of its output is gone.
"""

import sys
from typing import Any, TextIO


class _LossyStream:
    """A stream that discards what cannot be written."""

    def __init__(self, stream: TextIO) -> None:
        self.failure = ""
        """why something is missing, for people; empty if nothing is"""
        self._stream = stream

    def write(self, text: str) -> int:
        try:
            self._stream.write(text)
        except OSError as error:
            self.failure = error.strerror or str(error)
        return len(text)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except OSError as error:
            self.failure = error.strerror or str(error)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def protect_streams() -> None:
    """Make stdout and stderr of this process lossy; others that replace them are left alone."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is not None and stream is getattr(sys, f"__{name}__"):
            stream.reconfigure(errors="backslashreplace")
            setattr(sys, name, _LossyStream(stream))


def lost_output() -> dict[str, str]:
    """Why output is missing, by the name of the stream; flushes both."""
    failures = {}
    for name, stream in (("stdout", sys.stdout), ("stderr", sys.stderr)):
        if isinstance(stream, _LossyStream):
            stream.flush()
            if stream.failure:
                failures[name] = stream.failure
    return failures
