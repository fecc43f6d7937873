"""A CAN bus between the processes of one machine, for kernels without CAN and without a server.

python-can's own virtual bus does not leave its process, its multicast bus leaves the machine, and
its remote bus needs a server that costs a control step more than everything else. Here every
member has a UDP socket on 127.0.0.1 and sends each frame to all others. Who they are is written in
a folder that belongs to the user; nobody else is listened to.
"""

import os
import select
import socket
import struct
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can

HOST = "127.0.0.1"
FRAME = struct.Struct("<IB3x8s")
"""Linux's struct can_frame: identifier with flags, length, data"""
EXTENDED, REMOTE, ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000
IDENTIFIER = 0x1FFF_FFFF
BUFFER_BYTES = 1 << 20
REFRESH_NS = 100_000_000
"""a member that joined is sent to after at most so long"""
FAREWELL_NS = 1_000_000_000
"""how long one who left is still heard and spoken to: it, or the word of it, may be late"""


class LocalBus(can.BusABC):
    """python-can's interface `local`; `channel` is any name, the same for all members.

    Raises:
        can.CanInitializationError: the folder of the members belongs to somebody else, or cannot be
            made.
    """

    def __init__(self, channel: str = "local", can_filters: Any = None, **options: object) -> None:
        if options:
            raise can.CanInitializationError(
                f"expected no further options, found {', '.join(options)}"
            )
        self.channel_info = f"local bus {channel}"
        self._channel = channel
        self._folder = _folder_of(channel)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        self._socket.setblocking(False)
        self._socket.bind((HOST, 0))
        self._address: tuple[str, int] = self._socket.getsockname()
        self._mark = self._folder / str(self._address[1])
        self._mark.write_text(str(os.getpid()))
        self._others: list[tuple[str, int]] = []
        self._known_until_ns: dict[tuple[str, int], int] = {}
        self._refresh_ns = 0
        super().__init__(channel=channel, can_filters=can_filters)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """To all other members; one whose buffer is full loses the frame, as on any bus.

        Raises:
            can.CanOperationError: it is no classic CAN frame, or the bus is closed.
        """
        if msg.is_fd or msg.dlc > 8:
            raise can.CanOperationError("expected a classic CAN frame, found one of CAN FD")
        flags = (EXTENDED * msg.is_extended_id) | (REMOTE * msg.is_remote_frame)
        flags |= ERROR * msg.is_error_frame
        frame = FRAME.pack(msg.arbitration_id | flags, msg.dlc, bytes(msg.data))
        for address in self._members():
            try:
                self._socket.sendto(frame, address)
            except BlockingIOError:
                continue
            except OSError as error:
                raise can.CanOperationError(f"cannot send: {error}", error.errno) from error

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        try:
            if timeout != 0.0 and not select.select([self._socket], [], [], timeout)[0]:
                return None, False
            # What is no frame of a member must not hide those behind it.
            while True:
                frame, sender = self._socket.recvfrom(FRAME.size + 1)
                if len(frame) == FRAME.size and self._knows(sender):
                    return self._message(frame), False
        except BlockingIOError:
            return None, False
        except (OSError, ValueError) as error:
            raise can.CanOperationError(f"cannot receive: {error}") from error

    def _message(self, frame: bytes) -> can.Message:
        identifier, length, data = FRAME.unpack(frame)
        is_remote = bool(identifier & REMOTE)
        return can.Message(
            timestamp=time.time(),
            arbitration_id=identifier & IDENTIFIER,
            is_extended_id=bool(identifier & EXTENDED),
            is_remote_frame=is_remote,
            is_error_frame=bool(identifier & ERROR),
            dlc=length,
            data=None if is_remote else data[:length],
            channel=self._channel,
        )

    def fileno(self) -> int:
        """Of the socket, to wait for frames with."""
        return self._socket.fileno()

    def shutdown(self) -> None:
        """Leave; the others notice within a tenth of a second."""
        super().shutdown()
        self._mark.unlink(missing_ok=True)
        self._socket.close()

    def _members(self) -> list[tuple[str, int]]:
        now_ns = time.monotonic_ns()
        if now_ns >= self._refresh_ns:
            self._refresh_ns = now_ns + REFRESH_NS
            self._refresh(now_ns)
        return self._others

    def _refresh(self, now_ns: int) -> None:
        try:
            self._mark.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            self._mark.write_text(str(os.getpid()))  # cleaners of old files shall find it new
            present = list(_present(self._folder))
        except OSError:
            return  # whoever was there is spoken to as before
        for member in present:
            if member != self._address:
                self._known_until_ns[member] = now_ns + FAREWELL_NS
        self._others = [
            member for member, until_ns in self._known_until_ns.items() if until_ns >= now_ns
        ]

    def _knows(self, sender: tuple[str, int]) -> bool:
        if self._known_until_ns.get(sender, -1) >= time.monotonic_ns():
            return True
        self._members()  # it may have joined just now
        return self._known_until_ns.get(sender, -1) >= time.monotonic_ns()


def _folder_of(channel: str) -> Path:
    home = Path(tempfile.gettempdir()) / f"rt-controller-can-{os.getuid()}"
    name = "".join(letter if letter.isalnum() else f"%{ord(letter):x}" for letter in channel)
    folder = home / (name or "%")
    try:
        home.mkdir(mode=0o700, exist_ok=True)
        is_ours = home.stat().st_uid == os.getuid() and not home.is_symlink()
        folder.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise can.CanInitializationError(f"cannot make {folder}: {error.strerror}") from error
    if not is_ours:
        raise can.CanInitializationError(f"expected a folder {home} of this user, found another's")
    return folder


def _present(folder: Path) -> Iterator[tuple[str, int]]:
    """Addresses of the members; the marks of processes that died without a word are removed."""
    for mark in folder.iterdir():
        try:
            os.kill(int(mark.read_text()), 0)
        except (OSError, ValueError):
            if time.time() - _age_begin(mark) > 1.0:  # one that is just being written stays
                mark.unlink(missing_ok=True)
            continue
        yield HOST, int(mark.name)


def _age_begin(mark: Path) -> float:
    try:
        return mark.stat().st_mtime
    except OSError:
        return 0.0
