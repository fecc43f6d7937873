"""The multicast bus with a transport that stays in this process."""

from collections import deque
from collections.abc import Iterator
from typing import Any, ClassVar

import can
import pytest

from rt_controller.bus.inbox import Inbox
from rt_controller.bus.message import Node
from rt_controller.bus.transport import close_bus, open_bus

pytest.importorskip("msgpack")


class Group:
    """Members that receive all datagrams, their own too."""

    members: ClassVar[list["Group"]] = []

    def __init__(self, *_: object) -> None:
        self.datagrams: deque[bytes] = deque()
        Group.members.append(self)

    def send(self, data: bytes, timeout: float | None = None) -> None:
        for member in Group.members:
            member.datagrams.append(data)

    def recv(self, timeout: float | None = None) -> tuple[bytes, tuple[str, int], float] | None:
        return (self.datagrams.popleft(), ("127.0.0.1", 1), 0.0) if self.datagrams else None

    def fileno(self) -> int:
        return -1

    def shutdown(self) -> None:
        Group.members.remove(self)


@pytest.fixture
def pair(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[can.BusABC, can.BusABC]]:
    transport: Any = "can.interfaces.udp_multicast.bus.GeneralPurposeUdpMulticastBus"
    monkeypatch.setattr(transport, Group)
    near, far = open_bus("udp_multicast", "239.0.0.1"), open_bus("udp_multicast", "239.0.0.1")
    yield near, far
    close_bus(near)
    close_bus(far)


def frame(number: int) -> can.Message:
    return can.Message(arbitration_id=0x100, is_extended_id=False, data=bytes([number] * 8))


def test_a_sender_does_not_receive_its_own_frames_and_others_do(
    pair: tuple[can.BusABC, can.BusABC],
) -> None:
    near, far = pair
    for number in range(3):
        near.send(frame(number))
    far.send(frame(7))
    assert [far.recv(0).data[0] for _ in range(3)] == [0, 1, 2]  # type: ignore[union-attr]
    assert far.recv(0) is None
    received = near.recv(0)
    assert received is not None
    assert received.data[0] == 7
    assert near.recv(0) is None


def test_an_equal_frame_of_a_second_device_is_received(
    pair: tuple[can.BusABC, can.BusABC],
) -> None:
    near, far = pair
    near.send(frame(1))
    far.send(frame(1))
    assert near.recv(0) is not None
    assert near.recv(0) is None


def test_own_echoes_are_no_foreign_frames(pair: tuple[can.BusABC, can.BusABC]) -> None:
    from rt_controller.bus.catalogue import VEHICLE_IDENTITY
    from rt_controller.bus.identity import own_identity
    from rt_controller.bus.outbox import Outbox

    near, _ = pair
    inbox, outbox = Inbox(Node.VEHICLE), Outbox(near, Node.VEHICLE)
    outbox.send(VEHICLE_IDENTITY, own_identity(None), 0)
    inbox.drain(near, 0)
    assert inbox.foreign_frames == 0
