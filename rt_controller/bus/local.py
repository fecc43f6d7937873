"""A CAN bus between the processes of one machine, for kernels without CAN and without a server.

python-can's own virtual bus does not leave its process, its multicast bus leaves the machine, and
its remote bus needs a server that costs a control step more than everything else. Here every
member writes its frames into a ring of shared memory, and all others read them there: no system
call stands between the one and the other. The rings are files in a folder that belongs to the
user; nobody else can write into them.
"""

import os
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import can

from rt_controller.bus.ring import Ring, RingReader, is_orphaned

EXTENDED, REMOTE, ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000
"""flags beside the identifier, as in Linux's struct can_frame"""
IDENTIFIER = 0x1FFF_FFFF
REFRESH_NS = 100_000_000
"""a member that joined is heard after at most so long, from its first frame on"""
SETTLED_NS = 100_000_000
"""after a change, so long until the next one surely has another time"""
UNSEEN = -1
POLL_S = 0.0002
"""between two looks, for those who wait"""
SHARED_MEMORY = Path("/dev/shm")
"""files that no disk stands behind; where there is none, the folder for temporary files"""


class LocalBus(can.BusABC):
    """python-can's interface `local`; `channel` is any name, the same for all members.

    Raises:
        can.CanInitializationError: the folder of the rings belongs to somebody else, or cannot be
            made.
    """

    def __init__(self, channel: str = "local", can_filters: Any = None, **options: object) -> None:
        if options:
            raise can.CanInitializationError(
                f"expected no further options, found {', '.join(options)}"
            )
        self.channel_info = f"local bus {channel}"
        self._channel = channel
        self._others: dict[str, RingReader] = {}
        self._folder_ns = UNSEEN
        self._refresh_ns = 0
        self._is_open = True
        self._folder = _folder_of(channel)
        _sweep(self._folder.parent)
        self._join()
        self._joined_ns = time.monotonic_ns()
        super().__init__(channel=channel, can_filters=can_filters)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """To all other members; one who sleeps through thousands of frames loses the oldest.

        Raises:
            can.CanOperationError: it is no classic CAN frame, or the bus is closed.
        """
        self._require_open()
        if msg.is_fd or msg.dlc > 8:
            raise can.CanOperationError("expected a classic CAN frame, found one of CAN FD")
        identifier = msg.arbitration_id
        if msg.is_extended_id:
            identifier |= EXTENDED
        if msg.is_remote_frame:
            identifier |= REMOTE
        if msg.is_error_frame:
            identifier |= ERROR
        self._ring.append(time.time_ns(), identifier, msg.dlc, msg.data)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """As python-can's, but for those who do not wait without its detours."""
        if timeout != 0:
            return super().recv(timeout)
        self._require_open()
        while (message := self._take()) is not None:
            if self._matches_filters(message):
                return message
        return None

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self._require_open()
        until = None if timeout is None else time.monotonic() + timeout
        while (message := self._take()) is None:
            if until is not None and time.monotonic() >= until:
                break
            time.sleep(POLL_S)
        return message, False

    def shutdown(self) -> None:
        """Leave, as soon as everybody has had time to notice that one was there."""
        super().shutdown()
        if not self._is_open:
            return
        self._is_open = False
        unseen_ns = self._joined_ns + 2 * REFRESH_NS - time.monotonic_ns()
        if unseen_ns > 0 and not self._ring.is_empty:
            time.sleep(unseen_ns / 1e9)
        self._ring.remove()
        for reader in self._others.values():
            reader.close()
        with suppress(OSError):  # the last one to leave clears away
            self._folder.rmdir()

    def _take(self) -> can.Message | None:
        """The oldest frame that is there."""
        now_ns = time.monotonic_ns()
        if now_ns >= self._refresh_ns:
            self._refresh_ns = now_ns + REFRESH_NS
            self._refresh()
        waiting = [reader for reader in self._others.values() if reader.has_frames()]
        if not waiting:
            return None
        reader = waiting[0] if len(waiting) == 1 else min(waiting, key=RingReader.next_stamp_ns)
        stamp_ns, identifier, length, data = reader.take()
        is_remote = bool(identifier & REMOTE)
        return can.Message(
            timestamp=stamp_ns / 1e9,
            arbitration_id=identifier & IDENTIFIER,
            is_extended_id=bool(identifier & EXTENDED),
            is_remote_frame=is_remote,
            is_error_frame=bool(identifier & ERROR),
            dlc=length,
            data=None if is_remote else data[:length],
            channel=self._channel,
        )

    def _join(self) -> None:
        """Listen to those who are there, and be there too."""
        for attempts_left in (2, 1, 0):
            try:
                _make(self._folder)
                self._look_around(hears_all=False)
                self._ring = Ring(self._folder)
                return
            except OSError as error:
                # The folder may have been swept while it was still empty.
                if attempts_left == 0 or not isinstance(error, FileNotFoundError):
                    raise can.CanInitializationError(
                        f"cannot write into {self._folder}: {error.strerror}"
                    ) from error

    def _refresh(self) -> None:
        """Look who is there, if anything has changed."""
        try:
            changed_ns = self._folder.stat().st_mtime_ns
            if changed_ns == self._folder_ns:
                return
            is_complete = self._look_around(hears_all=True)
            if not self._ring.path.exists():  # the folder was cleared away under its members
                self._ring.remove()
                self._ring = Ring(self._folder)
                is_complete = False
        except FileNotFoundError:
            with suppress(OSError):
                _make(self._folder)
            self._folder_ns = UNSEEN
            return
        except OSError:
            return  # whoever was there is heard as before
        # A change in the same tick of the file system's clock would look like none.
        is_settled = time.time_ns() - changed_ns > SETTLED_NS
        self._folder_ns = changed_ns if is_complete and is_settled else UNSEEN

    def _look_around(self, hears_all: bool) -> bool:
        """Whether all rings are known now; `hears_all` of what a newcomer has said so far."""
        present = {path.name: path for path in self._folder.iterdir()}
        gone = self._others.keys() - present.keys()
        for name in [name for name in gone if not self._others[name].has_frames()]:
            self._others.pop(name).close()
        own = self._ring.path.name if hears_all else None
        is_complete = not gone & self._others.keys()
        for name in present.keys() - self._others.keys() - {own}:
            is_complete &= self._listen_to(present[name], hears_all)
        return is_complete

    def _listen_to(self, path: Path, hears_all: bool) -> bool:
        """Whether there is nothing left to do about this file."""
        try:
            if is_orphaned(path):
                path.unlink(missing_ok=True)
            else:
                self._others[path.name] = RingReader(path, hears_all)
        except OSError:
            return False  # it left in this moment, or cannot be read yet
        except ValueError:
            return True  # nothing of ours
        return True

    def _require_open(self) -> None:
        if not self._is_open:
            raise can.CanOperationError("expected an open bus, found one that is shut down")


def _folder_of(channel: str) -> Path:
    base = SHARED_MEMORY if os.access(SHARED_MEMORY, os.W_OK) else Path(tempfile.gettempdir())
    home = base / f"rt-controller-can-{os.getuid()}"
    name = "".join(letter if letter.isalnum() else f"%{ord(letter):x}" for letter in channel)
    try:
        home.mkdir(mode=0o700, exist_ok=True)
        is_ours = home.stat().st_uid == os.getuid() and not home.is_symlink()
    except OSError as error:
        raise can.CanInitializationError(f"cannot make {home}: {error.strerror}") from error
    if not is_ours:
        raise can.CanInitializationError(f"expected a folder {home} of this user, found another's")
    return home / (name or "%")


def _make(folder: Path) -> None:
    folder.parent.mkdir(mode=0o700, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)


def _sweep(home: Path) -> None:
    """Clear away what processes that were killed left on other channels."""
    for folder in home.iterdir():
        with suppress(OSError):
            for ring in folder.iterdir():
                if is_orphaned(ring):
                    ring.unlink(missing_ok=True)
            folder.rmdir()
