"""Opening a CAN bus through python-can, with a remedy for every failure.

python-can would merge settings from files and variables of the environment; here only the caller's
settings count.
"""

import errno
import socket
import struct
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
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

_VIRTUAL = "virtual"
_SOCKETCAN = "socketcan"
_REMOTE = "remote"
_MULTICAST = "udp_multicast"
_SLCAN = "slcan"
COMMON = (_VIRTUAL, "local", _SOCKETCAN, _REMOTE, _SLCAN, "pcan", "kvaser", "vector")
"""interfaces that a message names; the rest of python-can's are accepted too"""
_WITHOUT_BITRATE = (_VIRTUAL, _SOCKETCAN)
_WITHOUT_FD = (_SLCAN,)
_ALWAYS_FD = (_VIRTUAL, "local")
"""interfaces that carry frames of CAN FD without an option"""

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
        is_fd: for frames of CAN FD too.

    Raises:
        ConfigError: no such interface, one that cannot be used, or one that sets no bitrate; or
            a channel with a null character.
        BusError: no such channel, or the interface refuses these settings.
        MissingExtraError: the interface needs a package that is not installed.
    """
    require_interface(interface)
    if interface == _MULTICAST:
        raise ConfigError(
            f"`bus` {_MULTICAST}: expected an interface that does not return the frames that were "
            f"sent, which would be those of a second controller. Choose local or remote."
        )
    if "\0" in channel:  # a settings file can write one
        raise ConfigError(
            f"`channel`: expected the name of a channel, found {channel!r}, with a null character. "
            f"Correct the settings file."
        )
    settings: dict[str, Any] = dict(options or {})
    if is_fd and interface in _WITHOUT_FD:
        raise ConfigError(
            f"`fd`: expected an interface with CAN FD, found {interface}. Leave out --fd, or "
            f"choose virtual, local, socketcan, remote, pcan, kvaser or vector."
        )
    if is_fd and interface not in _ALWAYS_FD:
        settings["fd"] = True
    if interface == _VIRTUAL:
        settings.setdefault("rx_queue_size", VIRTUAL_QUEUE_FRAMES)
    if bitrate is not None:
        if interface in _WITHOUT_BITRATE:
            raise ConfigError(
                f"`bitrate` of {interface}: expected no bitrate, found {bitrate}: this interface "
                f"does not set one. Leave it out (for socketcan: ip link set {channel} type can "
                f"bitrate {bitrate})."
            )
        settings["bitrate"] = bitrate
    try:
        with _connection_limit(interface):
            bus = _open(interface, channel, settings)
    except Exception as error:  # each backend raises its own type
        raise explain_failure(interface, channel, error) from error
    if isinstance(bus, SocketcanBus):
        _enlarge_buffer(bus.socket)
    if interface == _REMOTE:
        # A server that has stopped in the middle of a frame must not delay the loop.
        bus.socket.settimeout(REMOTE_TIMEOUT_S)  # type: ignore[attr-defined]
    return bus


def _open(interface: str, channel: str, settings: dict[str, Any]) -> can.BusABC:
    if interface == _SLCAN:
        from rt_controller.bus.slcan import BoundedSlcanBus

        return BoundedSlcanBus(channel=channel, **settings)
    return can.Bus(channel=channel, interface=interface, ignore_config=True, **settings)


@contextmanager
def _connection_limit(interface: str) -> Iterator[None]:
    """A limit for connections that are made in this context; python-can-remote has none."""
    before = socket.getdefaulttimeout()
    if interface == _REMOTE:
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


def parse_options(written: Mapping[str, str]) -> dict[str, Option]:
    """Options as written on the command line, each with the type it would have in TOML."""
    return {name: _parse_option(value) for name, value in written.items()}


def _parse_option(value: str) -> Option:
    try:
        parsed = tomllib.loads(f"value = {value}")["value"]
    except (ValueError, RecursionError):  # no TOML, or a number without end
        return value
    return parsed if isinstance(parsed, bool | int | float | str) else value


def require_interface(interface: str) -> None:
    """Return if python-can has an interface of this name.

    Raises:
        ConfigError: it has not.
        MissingExtraError: its package is not installed.
    """
    if interface in can.VALID_INTERFACES:
        return
    if interface == _REMOTE:
        raise MissingExtraError(
            "remote: expected the package python-can-remote, found none. "
            f"Run: {install_command('remote')}"
        )
    near = hint(interface, {*can.VALID_INTERFACES, _REMOTE})
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
    number = getattr(error, "errno", None) or getattr(error, "error_code", None)
    if interface == _SOCKETCAN and number == errno.EAFNOSUPPORT:
        return BusError(
            f"{place}: expected a kernel with CAN, found one without AF_CAN. Load its module "
            f"(modprobe can can-raw vcan), or choose an interface that needs none: local "
            f"(between the processes of this machine), remote, slcan."
        )
    if interface == _SOCKETCAN and number == errno.ENODEV:
        return BusError(
            f"{place}: expected a network interface {channel}, found no such device. See "
            f"ip -brief link; for a virtual one: ip link add {channel} type vcan && "
            f"ip link set {channel} up."
        )
    if isinstance(error, TimeoutError):
        return BusError(
            f"{place}: expected a server that answers within {CONNECTION_TIMEOUT_S:g} s, found "
            f"none. Restart it, or correct the address."
        )
    if number == errno.ECONNREFUSED:
        return BusError(
            f"{place}: expected a server that listens there, found none (connection refused). "
            f"Start it first, or correct the address."
        )
    return BusError(
        f"{place}: expected a bus that opens, found {type(error).__name__}: {error}. Check the "
        f"channel and the options against python-can's page on {interface}."
    )
