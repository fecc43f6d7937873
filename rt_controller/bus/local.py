"""A CAN bus between the processes of one machine, for kernels without CAN and without a server.

python-can's own virtual bus is limited to one process, its multicast bus uses the network, and
its remote bus needs a server that costs more time than a control step. Here every member writes its
frames into a ring in shared memory, from which all others read them. The rings are files in a
folder that belongs to the user; other users cannot write into them.
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
FD, BIT_RATE_SWITCH, ERROR_STATE = 0x04, 0x01, 0x02
"""flags of frames of CAN FD, as in Linux's struct canfd_frame"""
LONGEST_CLASSIC, LONGEST_FD = 8, 64
"""bytes of data"""
REFRESH_NS = 100_000_000
"""the ring of a new member is read after at most this time, from its first frame on"""
POLL_S = 0.0002
"""between two checks for frames in a blocking `recv`"""
SHARED_MEMORY = Path("/dev/shm")
"""a file system in memory; where there is none, the folder for temporary files is used"""
IGNORED_OPTIONS = frozenset(
    {"single_handle", "bitrate", "data_bitrate", "fd", "timing", "receive_own_messages"}
)
"""options that python-can's tools and cantools pass to every interface; they have no effect here"""


class LocalBus(can.BusABC):
    """python-can's interface `local`; `channel` is any name, the same for all members.

    Raises:
        can.CanInitializationError: an unknown option, or the folder of the rings belongs to another
            user or cannot be made.
    """

    def __init__(self, channel: str = "local", can_filters: Any = None, **options: object) -> None:
        unknown = options.keys() - IGNORED_OPTIONS
        if unknown:
            raise can.CanInitializationError(
                f"expected no further options, found {', '.join(sorted(unknown))}"
            )
        self.channel_info = f"local bus {channel}"
        self._channel = channel
        self._others: dict[str, RingReader] = {}
        self._refresh_ns = 0
        self._is_open = True
        self._folder = _folder_of(channel)
        _remove_orphans(self._folder.parent)
        self._join()
        self._joined_ns = time.monotonic_ns()
        super().__init__(channel=channel, can_filters=can_filters)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send to all other members; one that does not read for thousands of frames loses some.

        Raises:
            can.CanOperationError: it has more data than its format allows, or the bus is closed.
        """
        self._require_open()
        longest = LONGEST_FD if msg.is_fd else LONGEST_CLASSIC
        if msg.dlc > longest:
            raise can.CanOperationError(f"expected {longest} bytes at most, found {msg.dlc}")
        flags = 0
        if msg.is_fd:
            flags = (
                FD
                | BIT_RATE_SWITCH * msg.bitrate_switch
                | ERROR_STATE * (msg.error_state_indicator)
            )
        identifier = msg.arbitration_id
        if msg.is_extended_id:
            identifier |= EXTENDED
        if msg.is_remote_frame:
            identifier |= REMOTE
        if msg.is_error_frame:
            identifier |= ERROR
        self._ring.append(time.time_ns(), identifier, msg.dlc, flags, msg.data)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """As python-can's `recv`; faster where `timeout` is 0."""
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
        """Close this member's end, not before the others have had time to read its frames."""
        super().shutdown()
        if not self._is_open:
            return
        self._is_open = False
        unread_ns = self._joined_ns + 2 * REFRESH_NS - time.monotonic_ns()
        if unread_ns > 0 and self._ring.count > 0:
            time.sleep(unread_ns / 1e9)
        self._ring.remove()
        for reader in self._others.values():
            reader.close()
        with suppress(OSError):  # the last member removes the folder
            self._folder.rmdir()

    def _take(self) -> can.Message | None:
        """The oldest unread frame."""
        now_ns = time.monotonic_ns()
        if now_ns >= self._refresh_ns:
            self._refresh_ns = now_ns + REFRESH_NS
            self._refresh()
        waiting = [reader for reader in self._others.values() if reader.has_frames()]
        if not waiting:
            return None
        reader = waiting[0] if len(waiting) == 1 else min(waiting, key=RingReader.next_stamp_ns)
        stamp_ns, identifier, length, flags, data = reader.take()
        is_remote = bool(identifier & REMOTE)
        return can.Message(
            timestamp=stamp_ns / 1e9,
            arbitration_id=identifier & IDENTIFIER,
            is_extended_id=bool(identifier & EXTENDED),
            is_remote_frame=is_remote,
            is_error_frame=bool(identifier & ERROR),
            is_fd=bool(flags & FD),
            bitrate_switch=bool(flags & BIT_RATE_SWITCH),
            error_state_indicator=bool(flags & ERROR_STATE),
            dlc=length,
            data=None if is_remote else data[:length],
            channel=self._channel,
        )

    def _join(self) -> None:
        """Open the rings of the members, then make one's own."""
        for attempts_left in (2, 1, 0):
            try:
                _make(self._folder)
                self._update_members(set(os.listdir(self._folder)), from_first=False)
                self._ring = Ring(self._folder)
                return
            except OSError as error:
                # Another member may have removed the folder while it was still empty.
                if attempts_left == 0 or not isinstance(error, FileNotFoundError):
                    raise can.CanInitializationError(
                        f"cannot write into {self._folder}: {error.strerror}"
                    ) from error

    def _refresh(self) -> None:
        """Open the rings of new members; after an error the known members are read as before."""
        with suppress(OSError):
            _make(self._folder)
            names = set(os.listdir(self._folder))
            if self._ring.path.name not in names:  # the folder was removed while in use
                self._ring.remove()
                self._ring = Ring(self._folder)
            self._update_members(names - {self._ring.path.name}, from_first=True)

    def _update_members(self, names: set[str], from_first: bool) -> None:
        """Open new rings, to be read `from_first` frame or from now on; close those that ended."""
        for name in self._others.keys() - names:
            if not self._others[name].has_frames():
                self._others.pop(name).close()
        for name in names - self._others.keys():
            path = self._folder / name
            # It may have been removed in this moment, or may not be a ring.
            with suppress(OSError, ValueError):
                if is_orphaned(path):
                    path.unlink(missing_ok=True)
                else:
                    self._others[name] = RingReader(path, from_first)

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


def _remove_orphans(home: Path) -> None:
    """Remove the files that killed processes left on any channel."""
    for folder in home.iterdir():
        with suppress(OSError):
            for ring in folder.iterdir():
                with suppress(OSError, ValueError):
                    if is_orphaned(ring):
                        ring.unlink(missing_ok=True)
            folder.rmdir()
