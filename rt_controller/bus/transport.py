"""Opening a CAN bus through python-can, with a remedy for every failure.

python-can would merge settings from files and variables of the environment; here only the caller's
settings count.
"""

import errno
import logging
import socket
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from importlib import import_module
from threading import Thread
from typing import Any

import can
from can.interfaces.socketcan import SocketcanBus

from rt_controller.contract.errors import (
    BusError,
    ConfigError,
    MissingExtraError,
    RtControllerError,
    install_command,
)
from rt_controller.contract.names import hint

Option = str | int | float | bool

COMMON = ("virtual", "local", "socketcan", "remote", "slcan", "pcan", "kvaser", "vector")
"""interfaces that a message names; the rest of python-can's are accepted too"""
_WITH_FD = {"virtual": {}, "local": {}, "socketcan": {"fd": True}, "remote": {"fd": True}}
"""interfaces that carry frames of CAN FD, with the option that they need; others have a timing"""

VIRTUAL_QUEUE_FRAMES = 1024
"""A virtual bus that is not read refuses frames after this many, instead of filling the memory."""
CONNECTION_TIMEOUT_S = 10.0
"""of a server that does not answer when the bus is opened"""
REMOTE_TIMEOUT_S = 0.01
"""of a server that stops answering in the middle of a frame"""
LONGEST_CLOSE_S = 2.0
"""for the other end to answer when a bus is closed; python-can-remote waits without end"""
SOCKET_BUFFER_BYTES = 1 << 20
"""Asked of the kernel, which may grant less; by default the 279th unread frame is lost silently."""
_SO_RCVBUFFORCE, _SO_MEMINFO = 33, 55
_MEMINFO = struct.Struct("9I")
"""the last number: frames that found no room in the buffer"""
_OTHER_FAILURE = (
    "expected a bus that opens, found {found}. Check the channel and the options against "
    "python-can's page on {interface}."
)
_FAILURES = {
    ("socketcan", errno.EAFNOSUPPORT): (
        "expected a kernel with CAN, found one without AF_CAN. Load its module (modprobe can "
        "can-raw vcan), or choose an interface that needs none: local (between the processes of "
        "this machine), remote, slcan."
    ),
    ("socketcan", errno.ENODEV): (
        "expected a network interface {channel}, found no such device. See ip -brief link; for a "
        "virtual one: ip link add {channel} type vcan && ip link set {channel} up."
    ),
    ("remote", errno.ETIMEDOUT): (
        "expected a server that answers in time, found none. Restart it, or correct the address."
    ),
    ("remote", errno.ECONNREFUSED): (
        "expected a server that listens there, found none (connection refused). Start it first, "
        "or correct the address."
    ),
}
"""what was expected and found, and the remedy, by interface and number of the error"""


def open_bus(
    interface: str,
    channel: str,
    bitrate: int | None = None,
    options: Mapping[str, Option] | None = None,
    is_fd: bool = False,
) -> can.BusABC:
    """An open bus; the caller shuts it down.

    Args:
        interface: python-can's name: "virtual", "socketcan", "slcan", "remote"...
        channel: "vcan0", "/dev/ttyACM0", "ws://127.0.0.1:54701"...
        bitrate: in bit/s, for adapters that the program has to set.
        options: further arguments of the interface, as python-can documents them.
        is_fd: for frames of CAN FD too, which a car's own messages may be.

    Raises:
        ConfigError: no such interface, one that cannot be used, or one that sets no bitrate or
            has no CAN FD.
        BusError: no such channel, or the interface refuses these settings.
        MissingExtraError: the interface needs a package that is not installed.
    """
    require_interface(interface)
    if interface == "udp_multicast":
        raise ConfigError(
            "`bus` udp_multicast: expected an interface that does not return the frames that were "
            "sent, which would be those of a second controller. Choose local or remote."
        )
    settings: dict[str, Any] = dict(options or {})
    if is_fd:
        if interface not in _WITH_FD:
            raise ConfigError(
                f"{interface} {channel}: expected {', '.join(_WITH_FD)} for a DBC with messages of "
                f"CAN FD, found {interface}. Use the adapter through socketcan, or leave these "
                f"messages out of the DBC."
            )
        settings |= _WITH_FD[interface]
    if interface == "virtual":
        settings.setdefault("rx_queue_size", VIRTUAL_QUEUE_FRAMES)
    if bitrate is not None:
        if interface in ("virtual", "socketcan"):
            raise ConfigError(
                f"`bitrate` of {interface}: expected no bitrate, found {bitrate}: this interface "
                f"does not set one. Leave it out (for socketcan: ip link set {channel} type can "
                f"bitrate {bitrate})."
            )
        settings["bitrate"] = bitrate
    _import_quietly(interface)
    try:
        if interface == "slcan":
            from rt_controller.bus.slcan import BoundedSlcanBus  # needs the package serial

            return BoundedSlcanBus(channel=channel, **settings)
        with _connection_limit() if interface == "remote" else nullcontext():
            bus = can.Bus(channel=channel, interface=interface, ignore_config=True, **settings)
    except Exception as error:  # each backend raises its own type
        raise explain_failure(interface, channel, error) from error
    if isinstance(bus, SocketcanBus):
        _enlarge_buffer(bus.socket)
    if interface == "remote":
        # A server that has stopped in the middle of a frame must not delay the loop.
        bus.socket.settimeout(REMOTE_TIMEOUT_S)  # type: ignore[attr-defined]
    return bus


def _import_quietly(interface: str) -> None:
    """Import the interface without what it logs meanwhile: packages that it may do without.

    One that it needs is named where the bus is opened, and so is an import that fails. What is
    logged later stays visible.
    """
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        with suppress(Exception):  # `can.Bus` raises it again
            import_module(can.interfaces.BACKENDS[interface][0])
    finally:
        logging.disable(before)


@contextmanager
def _connection_limit() -> Iterator[None]:
    """A limit for connections that are made in this context; python-can-remote has none."""
    before = socket.getdefaulttimeout()
    socket.setdefaulttimeout(CONNECTION_TIMEOUT_S)
    try:
        yield
    finally:
        socket.setdefaulttimeout(before)


def overflowed_frames(bus: object) -> int:
    """Frames lost since this bus was opened because its buffer was full; 0 if unknown."""
    if not isinstance(bus, SocketcanBus):
        return 0
    try:
        numbers = bus.socket.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size)
    except OSError:  # a kernel before 4.12
        return 0
    return int(_MEMINFO.unpack(numbers)[-1])


def _enlarge_buffer(opened: socket.socket) -> None:
    """Ask for the buffer beyond the limit of the system, which root may, or up to it."""
    try:
        opened.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, SOCKET_BUFFER_BYTES)
    except OSError:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SOCKET_BUFFER_BYTES)


def close_bus(bus: can.BusABC) -> None:
    """Shut down a bus, also one that has failed, or whose other end does not answer."""
    closing = Thread(target=_shut_down, args=(bus,), name="closing", daemon=True)
    closing.start()
    closing.join(LONGEST_CLOSE_S)
    if closing.is_alive():
        can.BusABC.shutdown(bus)


def _shut_down(bus: can.BusABC) -> None:
    try:
        bus.shutdown()
    except Exception:
        # Each backend raises its own type, and the cause was reported while the bus was in use.
        # The base class only marks the bus as closed: else it tries again at garbage collection.
        can.BusABC.shutdown(bus)


def require_interface(interface: str) -> None:
    """Return if python-can has an interface of this name.

    Raises:
        ConfigError: it has not.
        MissingExtraError: its package is not installed.
    """
    if interface in can.VALID_INTERFACES:
        return
    if interface == "remote":
        raise MissingExtraError(
            "remote: expected the package python-can-remote, found none. "
            f"Run: {install_command('remote')}"
        )
    near = hint(interface, {*can.VALID_INTERFACES, "remote"})
    raise ConfigError(
        f"`bus` {interface!r}: expected {', '.join(COMMON)} or another interface of "
        f"python-can, found no such name{near}."
    )


def explain_failure(interface: str, channel: str, error: Exception) -> RtControllerError:
    """The error to raise when an interface could not be opened: expected, found, remedy."""
    place = f"{interface} {channel}"
    if isinstance(error, can.CanInterfaceNotImplementedError):
        return MissingExtraError(
            f"{place}: expected what this interface needs, found: {error}. Install what "
            f"python-can's page on {interface} names, or choose another interface."
        )
    number = getattr(error, "errno", None) or getattr(error, "error_code", None) or 0
    if isinstance(error, TimeoutError):
        number = errno.ETIMEDOUT
    text = _FAILURES.get((interface, number), _OTHER_FAILURE)
    found = f"{type(error).__name__}: {error}"
    return BusError(f"{place}: {text.format(interface=interface, channel=channel, found=found)}")
