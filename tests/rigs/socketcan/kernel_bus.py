"""The CAN interface of the running kernel."""

import os
import subprocess
import time

import can

from rt_controller.bus.receive import Inbox

CHANNEL = os.environ.get("CAN_CHANNEL", "vcan0")
_PATIENCE_S = 30.0


def switch(state: str) -> None:
    """Bring the interface up or down."""
    subprocess.run(["ip", "link", "set", CHANNEL, state], check=True)


def drain_frames(inbox: Inbox, bus: can.BusABC, n_frames: int, now_ns: int = 0) -> int:
    """Number of frames read: `n_frames`, or fewer if no more arrive within half a minute.

    A busy kernel delivers a frame some time after `send` has returned.
    """
    give_up, read = time.monotonic() + _PATIENCE_S, 0
    while read < n_frames and time.monotonic() < give_up:
        read += inbox.drain(bus, now_ns, n_frames - read)
    return read
