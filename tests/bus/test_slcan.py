"""A serial adapter that has stopped taking frames holds up no program."""

import os
import threading
import tty

import can
import pytest

from rt_controller.bus.transport import close_bus, open_bus

MOST_FRAMES = 100_000


def test_a_full_buffer_of_the_port_is_an_error_of_the_send() -> None:
    pytest.importorskip("serial")
    adapter, port = os.openpty()
    tty.setraw(port)
    bus = open_bus("slcan", os.ttyname(port), 500_000, {"sleep_after_open": 0.0})
    errors: list[can.CanError] = []

    def send() -> None:
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
