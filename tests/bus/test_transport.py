"""Opening a bus: what works, and messages with a remedy for what does not."""

import errno
import gc
import os
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import pytest
from can.interfaces.virtual import VirtualBus

from rt_controller.bus import transport
from rt_controller.bus.transport import close_bus, explain_failure, open_bus, parse_options
from rt_controller.contract.errors import BusError, ConfigError, MissingExtraError


def message(data: bytes) -> can.Message:
    return can.Message(arbitration_id=0x123, is_extended_id=False, data=data, check=True)


def test_a_virtual_bus_reaches_others_but_not_itself() -> None:
    with open_bus("virtual", "pair") as near, open_bus("virtual", "pair") as far:
        near.send(message(b"\x01"), timeout=0)
        assert near.recv(0) is None
        received = far.recv(0)
        assert received is not None
        assert received.data == b"\x01"


def test_settings_of_the_environment_are_ignored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """python-can would read receive_own_messages from can.ini in the working directory."""
    (tmp_path / "can.ini").write_text(
        "[default]\ninterface = virtual\nchannel = ambient\nreceive_own_messages = True\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("CAN_CONFIG", '{"receive_own_messages": true}')
    with open_bus("virtual", "explicit") as bus:
        bus.send(message(b"\x01"), timeout=0)
        assert bus.recv(0) is None
        assert "explicit" in bus.channel_info


def test_options_reach_the_interface() -> None:
    with open_bus("virtual", "own", options={"receive_own_messages": True}) as bus:
        bus.send(message(b"\x01"), timeout=0)
        assert bus.recv(0) is not None


@pytest.mark.parametrize(
    ("interface", "channel", "more", "error", "words"),
    [
        ("soketcan", "vcan0", {}, ConfigError, "'soketcan'.*virtual, local.*did you mean socketc"),
        ("udp_multicast", "239.0.0.1", {}, ConfigError, "udp_multicast: expected .* Choose local"),
        ("virtual", "a\0b", {}, ConfigError, r"`channel`: expected .*, found 'a\\x00b'"),
        # On a kernel without CAN the message says that; either way it has a remedy.
        ("socketcan", "vcan77", {}, BusError, "socketcan vcan77: expected .* found"),
        ("virtual", "can0", {"bitrate": 500_000}, ConfigError, "expected no bitrate, found 500000"),
        ("socketcan", "can0", {"bitrate": 500_000}, ConfigError, "expected no bitrate"),
        ("virtual", "x", {"options": {"interface": "y"}}, BusError, "found TypeError.*options"),
    ],
)
def test_a_bus_that_cannot_be_opened_is_refused(
    interface: str, channel: str, more: dict[str, Any], error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        open_bus(interface, channel, **more)


@pytest.mark.parametrize(
    ("interface", "error", "expected", "words"),
    [
        ("socketcan", OSError(errno.EAFNOSUPPORT, "x"), BusError, "modprobe"),
        ("socketcan", OSError(errno.ENODEV, "x"), BusError, "ip link add can7 type vcan"),
        ("socketcan", OSError(errno.ENETDOWN, "is down"), BusError, "is down"),
        ("remote", ConnectionRefusedError(errno.ECONNREFUSED, "x"), BusError, "Start it first"),
        ("pcan", can.CanInitializationError("no hardware"), BusError, "no hardware"),
        ("slcan", can.CanInterfaceNotImplementedError("no serial"), MissingExtraError, "no serial"),
    ],
)
def test_every_failure_is_explained(
    interface: str, error: Exception, expected: type[Exception], words: str
) -> None:
    explained = explain_failure(interface, "can7", error)
    assert type(explained) is expected
    assert words in str(explained)
    assert str(explained).startswith(f"{interface} can7: expected ")


def test_the_interface_remote_without_its_package_names_the_extra(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    without = frozenset(can.VALID_INTERFACES) - {"remote"}
    monkeypatch.setattr(can, "VALID_INTERFACES", without)
    with pytest.raises(MissingExtraError, match=r"pip install .*\[remote\]"):
        open_bus("remote", "ws://127.0.0.1:54701")


@pytest.fixture
def remote_channel() -> Iterator[str]:
    """Address of a python-can-remote server in front of a virtual bus."""
    can_remote = pytest.importorskip("can_remote")
    server = can_remote.RemoteServer(
        host="127.0.0.1", port=0, interface="virtual", channel=f"remote-{os.getpid()}"
    )
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"ws://127.0.0.1:{server.server_port}/"
    server.shutdown()
    server.server_close()
    thread.join()


def test_two_ends_of_a_remote_bus_reach_each_other(remote_channel: str) -> None:
    with (
        open_bus("remote", remote_channel, bitrate=500_000) as near,
        open_bus("remote", remote_channel) as far,
    ):
        near.send(message(b"\x01\x02"), timeout=0)
        received = far.recv(5.0)
        assert received is not None
        assert received.data == b"\x01\x02"
        assert near.recv(0) is None


def test_a_remote_bus_without_server_is_refused() -> None:
    pytest.importorskip("can_remote")
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
    with pytest.raises(BusError, match=r"expected a server .* found none"):
        open_bus("remote", f"ws://127.0.0.1:{port}/")


def test_written_options_get_their_toml_type() -> None:
    written = {"fd": "true", "loopback": "false", "ttyBaudrate": "115200", "host": "127.0.0.1"}
    parsed = parse_options({**written, "ratio": "0.5", "day": "2026-01-01"})
    assert parsed == {
        "fd": True,
        "loopback": False,
        "ttyBaudrate": 115200,
        "host": "127.0.0.1",
        "ratio": 0.5,
        "day": "2026-01-01",
    }


def test_closing_a_bus_that_has_failed_raises_nothing(
    monkeypatch: pytest.MonkeyPatch, recwarn: pytest.WarningsRecorder
) -> None:
    class Gone(VirtualBus):
        attempts = 0

        def shutdown(self) -> None:
            Gone.attempts += 1
            raise OSError("the other end is gone")

    bus = Gone(channel="gone")
    close_bus(bus)
    del bus
    gc.collect()
    assert Gone.attempts == 1
    assert not [each for each in recwarn if "unraisable" in str(each.message).lower()]


def test_closing_a_bus_whose_other_end_does_not_answer_is_given_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    answered = threading.Event()

    class Frozen(VirtualBus):
        def shutdown(self) -> None:
            answered.wait()

    monkeypatch.setattr(transport, "LONGEST_CLOSE_S", 0.01)
    bus = Frozen(channel="frozen")
    close_bus(bus)
    assert bus._is_shutdown
    answered.set()


def test_a_server_that_accepts_and_says_nothing_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("can_remote")
    monkeypatch.setattr(transport, "CONNECTION_TIMEOUT_S", 0.05)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        with pytest.raises(BusError, match=r"expected a server that answers .* found none"):
            open_bus("remote", f"ws://127.0.0.1:{port}/")
    assert socket.getdefaulttimeout() is None
