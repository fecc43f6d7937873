"""Frames that were sent, for a reader in the same thread."""

from collections import deque

import can

MAX_FRAMES = 1024
"""kept; the oldest are dropped"""


class FrameQueue:
    """Takes frames as a bus does, and keeps copies: a sender uses its frames again."""

    def __init__(self) -> None:
        self.frames: deque[can.Message] = deque(maxlen=MAX_FRAMES)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Keep a copy."""
        self.frames.append(
            can.Message(
                arbitration_id=msg.arbitration_id,
                is_extended_id=msg.is_extended_id,
                data=bytes(msg.data),
            )
        )
