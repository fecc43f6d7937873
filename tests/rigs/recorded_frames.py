"""A recorder that keeps all frames in memory."""

import can

from rt_controller.bus.codec import FrameCodec


class RecordedFrames:
    """Arrival time in ns, number and data of each frame, by copy, in order."""

    def __init__(self) -> None:
        self.frames: list[tuple[int, int, bytes]] = []

    def record(self, message: can.Message, timestamp_ns: int, is_sent: bool = False) -> None:
        self.frames.append((timestamp_ns, message.arbitration_id, bytes(message.data)))

    def of(self, codec: FrameCodec) -> list[bytes]:
        """The data of the frames of one codec."""
        return [data for _, number, data in self.frames if number == codec.arbitration_id]
