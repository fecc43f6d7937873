"""Serial CAN adapters that are connected to one bus, as pseudo terminals.

They speak the ASCII protocol of slcan: `O` or `L` opens the channel, `C` closes it, and a line that
begins with a frame's letter is a frame for all other adapters whose channel is open.
"""

import os
import pty
import select
import threading
import tty
from contextlib import AbstractContextManager, suppress
from typing import Self

_END = b"\r"
_FRAMES = b"tTrRdDbB"
_STOP_POLL_S = 0.1


class SlcanHub(AbstractContextManager["SlcanHub"]):
    """`ports` are the names of the terminals, one for each program."""

    def __init__(self, n_ports: int) -> None:
        pairs = [pty.openpty() for _ in range(n_ports)]
        self.ports = [os.ttyname(theirs) for _, theirs in pairs]
        self._theirs = [theirs for _, theirs in pairs]
        """kept open, so that a program may close its port and another one open it"""
        self._unread = {ours: b"" for ours, _ in pairs}
        self._open: set[int] = set()
        self._is_ending = threading.Event()
        for ours, theirs in pairs:
            tty.setraw(theirs)
            os.set_blocking(ours, False)
        self._thread = threading.Thread(target=self._run, name="slcan hub", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_ending.set()
        self._thread.join()
        for descriptor in (*self._unread, *self._theirs):
            os.close(descriptor)

    def _run(self) -> None:
        while not self._is_ending.is_set():
            for port in select.select(list(self._unread), [], [], _STOP_POLL_S)[0]:
                *lines, self._unread[port] = (self._unread[port] + os.read(port, 65_536)).split(
                    _END
                )
                for line in lines:
                    self._accept(port, line)

    def _accept(self, port: int, line: bytes) -> None:
        if line[:1] in (b"O", b"L"):
            self._open.add(port)
        elif line[:1] == b"C":
            self._open.discard(port)
        elif line and line[0] in _FRAMES:
            for other in self._open - {port}:
                with suppress(BlockingIOError):  # a port that is not read loses frames
                    os.write(other, line + _END)
