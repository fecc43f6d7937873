"""A program with a text interface in a pseudo terminal."""

import fcntl
import os
import pty
import struct
import subprocess
import termios
import threading
import time
from contextlib import AbstractContextManager
from typing import Self

_ROWS, _COLUMNS = 200, 120
_PATIENCE_S = 300.0


class TerminalTool(AbstractContextManager["TerminalTool"]):
    """Runs a program; its output is read all the time, and kept in `shown`."""

    def __init__(self, *command: str | os.PathLike[str]) -> None:
        self.shown = b""
        self._ours, theirs = pty.openpty()
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", _ROWS, _COLUMNS, 0, 0))
        # A program that pytest has loaded may have left the size of another terminal here.
        size = {"LINES": str(_ROWS), "COLUMNS": str(_COLUMNS)}
        environment = {**os.environ, "TERM": "xterm", **size}
        self._process = subprocess.Popen(
            command, stdin=theirs, stdout=theirs, stderr=theirs, env=environment
        )
        os.close(theirs)
        self._reader = threading.Thread(target=self._read, daemon=True)

    def __enter__(self) -> Self:
        self._reader.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        self._reader.join()
        os.close(self._ours)

    def wait_for(self, *texts: bytes) -> None:
        """Wait until the program has shown each of these texts."""
        give_up = time.monotonic() + _PATIENCE_S
        while missing := [text for text in texts if text not in self.shown]:
            assert self._process.poll() is None, self.shown[-2000:]
            assert time.monotonic() < give_up, f"expected {missing}, found {self.shown[-2000:]!r}"
            time.sleep(0.02)

    def press(self, key: bytes) -> int:
        """Exit status of a program that this key ends."""
        os.write(self._ours, key)
        return self._process.wait(_PATIENCE_S)

    def _read(self) -> None:
        try:
            while found := os.read(self._ours, 65_536):
                self.shown += found
        except OSError:  # no program has the other end open any more
            return
