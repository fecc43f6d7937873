"""python-can's multicast bus, without the echoes of one's own frames.

The group returns every frame to the sockets of its own sender too, and python-can passes them on as
received. To the source checks of this project they would be frames of a second device.
"""

import time
from collections import deque
from typing import Any

import can
from can.interfaces.udp_multicast import UdpMulticastBus

AWAITED_ECHOES = 64
"""sent frames whose echo may still come: half a second of one end's frames"""

_Key = tuple[int, bool, bytes]


class EchoFreeMulticastBus(UdpMulticastBus):
    """The interface udp_multicast; every frame that was sent hides one equal frame that arrives."""

    def __init__(self, **settings: Any) -> None:
        """As python-can's; raises its errors."""
        self._awaited: deque[_Key] = deque(maxlen=AWAITED_ECHOES)
        super().__init__(**settings)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame; its echo will not be received."""
        super().send(msg, timeout)
        self._awaited.append(_key(msg))

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        until_s = None if timeout is None else time.monotonic() + timeout
        while True:
            left_s = None if until_s is None else max(until_s - time.monotonic(), 0.0)
            message, is_filtered = super()._recv_internal(left_s)
            if message is None or _key(message) not in self._awaited:
                return message, is_filtered
            self._awaited.remove(_key(message))


def _key(message: can.Message) -> _Key:
    return message.arbitration_id, message.is_extended_id, bytes(message.data)
