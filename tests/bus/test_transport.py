"""Opening and closing a bus, its condition, and messages with a remedy for what does not work."""

import errno
import gc
import os
import socket
import threading
import tty
from collections.abc import Iterator

import can
import pytest
from can.interfaces.virtual import VirtualBus

from rt_controller.bus import transport
from rt_controller.bus.condition import BusCondition, BusState, is_queue_full
from rt_controller.bus.transport import close_bus, explain_failure, open_bus
from rt_controller.contract.errors import BusError, ConfigError, MissingExtraError
from rt_controller.settings import BusSettings


def message(data: bytes) -> can.Message:
    return can.Message(arbitration_id=0x123, is_extended_id=False, data=data, check=True)


def test_settings_of_the_environment_are_ignored(tmp_path, monkeypatch):
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


@pytest.mark.parametrize(
    ("interface", "channel", "more", "error", "words"),
    [
        ("soketcan", "vcan0", {}, ConfigError, "'soketcan'.*virtual, local.*did you mean socketc"),
        ("udp_multicast", "239.0.0.1", {}, ConfigError, "udp_multicast: expected .* Choose local"),
        # On a kernel without CAN the message says that; either way it has a remedy.
        ("socketcan", "vcan77", {}, BusError, "socketcan vcan77: expected .* found"),
        ("virtual", "can0", {"bitrate": 500_000}, ConfigError, "expected no bitrate, found 500000"),
        ("socketcan", "can0", {"bitrate": 500_000}, ConfigError, "expected no bitrate"),
        ("virtual", "x", {"options": {"interface": "y"}}, BusError, "found TypeError.*options"),
        ("slcan", "x", {"is_fd": True}, ConfigError, "CAN FD, found slcan.*socketcan"),
    ],
)
def test_a_bus_that_cannot_be_opened_is_refused(interface, channel, more, error, words):
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
def test_every_failure_is_explained(interface, error, expected, words):
    explained = explain_failure(interface, "can7", error)
    assert type(explained) is expected
    assert words in str(explained)
    assert str(explained).startswith(f"{interface} can7: expected ")


def test_the_interface_remote_without_its_package_names_the_extra(monkeypatch):
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


def test_two_ends_of_a_remote_bus_reach_each_other(remote_channel):
    with (
        open_bus("remote", remote_channel, bitrate=500_000) as near,
        open_bus("remote", remote_channel) as far,
    ):
        near.send(message(b"\x01\x02"), timeout=0)
        received = far.recv(5.0)
        assert received.data == b"\x01\x02"
        assert near.recv(0) is None


def test_a_written_option_arrives_as_the_number_or_truth_value_that_it_is(monkeypatch):
    written = {"rx_queue_size": "1", "preserve_timestamps": "true", "protocol": "ab1"}
    arrived = {}
    monkeypatch.setattr(can, "Bus", lambda **settings: arrived.update(settings))
    BusSettings(bus="virtual", channel="options", bus_option=written).open_bus()
    assert arrived.items() >= {"rx_queue_size": 1, "protocol": "ab1"}.items()
    assert arrived["preserve_timestamps"] is True


def test_closing_a_bus_that_has_failed_raises_nothing(monkeypatch, recwarn):
    class Gone(VirtualBus):
        attempts = 0

        def shutdown(self):
            Gone.attempts += 1
            raise OSError("the other end is gone")

    bus = Gone(channel="gone")
    close_bus(bus)
    del bus
    gc.collect()
    assert Gone.attempts == 1
    assert not [each for each in recwarn if "unraisable" in str(each.message).lower()]


def test_closing_a_bus_whose_other_end_does_not_answer_is_given_up(monkeypatch):
    answered = threading.Event()

    class Frozen(VirtualBus):
        def shutdown(self):
            answered.wait()

    monkeypatch.setattr(transport, "LONGEST_CLOSE_S", 0.01)
    bus = Frozen(channel="frozen")
    close_bus(bus)
    assert bus._is_shutdown
    answered.set()


MOST_FRAMES = 100_000


def test_a_full_buffer_of_the_port_is_an_error_of_the_send():
    pytest.importorskip("serial")
    adapter, port = os.openpty()
    tty.setraw(port)
    bus = open_bus("slcan", os.ttyname(port), 500_000, {"sleep_after_open": 0.0})
    errors: list[can.CanError] = []

    def send():
        frame = can.Message(arbitration_id=0x123, is_extended_id=False, data=bytes(8))
        for _ in range(MOST_FRAMES):
            try:
                bus.send(frame, timeout=0.0)
            except can.CanError as error:
                errors.append(error)
                return

    sender = threading.Thread(target=send, daemon=True)
    sender.start()
    sender.join(10.0)
    os.close(adapter)
    os.close(port)
    assert not sender.is_alive()
    assert len(errors) == 1
    close_bus(bus)


@pytest.mark.parametrize(
    ("frames", "state", "counts"),
    [
        (((0x004, 0x04),), BusState.WARNING, {}),
        (((0x004, 0x20),), BusState.PASSIVE, {}),
        (((0x204, 0x0C | 0x30),), BusState.PASSIVE, {}),
        (((0x040, 0x00),), BusState.BUS_OFF, {"bus_off": 1}),
        (((0x0C8, 0x00),), BusState.BUS_OFF, {"bus_off": 1}),
        (((0x008, 0x3C),), BusState.ACTIVE, {}),
        (((0x020, 0x00),), BusState.ACTIVE, {}),
        (((0x040, 0), (0x100, 0)), BusState.ACTIVE, {"bus_off": 1, "restarts": 1}),
        (((0x004, 0x20), (0x004, 0x40)), BusState.ACTIVE, {}),
        (((0x004, 0x01),), BusState.ACTIVE, {"controller_overflows": 1}),
        (((0x004, 0x02),), BusState.ACTIVE, {"controller_overflows": 1}),
        (((0x004, None),), BusState.ACTIVE, {}),  # without data
    ],
)
def test_error_frames_give_the_state_and_are_counted(frames, state, counts):
    condition = BusCondition()
    for classes, detail in frames:
        data = b"" if detail is None else bytes((0, detail, 0, 0, 0, 0, 0, 0))
        condition.note_error_frame(
            can.Message(
                arbitration_id=classes, is_extended_id=False, is_error_frame=True, data=data
            )
        )
    assert condition == BusCondition(state, error_frames=len(frames), **counts)
    assert state.is_disturbed == (state not in (BusState.ACTIVE, BusState.WARNING))


def test_a_full_queue_is_distinguished_from_other_failures():
    assert is_queue_full(can.CanOperationError("No buffer space available", errno.ENOBUFS))
    assert is_queue_full(can.CanOperationError("Transmit buffer full"))
    assert not is_queue_full(can.CanOperationError("Network is down", errno.ENETDOWN))


@pytest.mark.parametrize("listens", [False, True])
def test_a_server_that_is_missing_or_says_nothing_is_refused_in_time(monkeypatch, listens):
    pytest.importorskip("can_remote")
    monkeypatch.setattr(transport, "CONNECTION_TIMEOUT_S", 0.05)
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        if listens:
            server.listen()
        expected = "a server that answers" if listens else "a server"
        with pytest.raises(BusError, match=rf"expected {expected} .* found none"):
            open_bus("remote", f"ws://127.0.0.1:{server.getsockname()[1]}/")
    assert socket.getdefaulttimeout() is None
