"""Contents for the messages of the bus, and the CAN frames that carry them."""

from typing import Any, TypeVar

import can

from rt_controller.bus.codec import Frame, FrameCodec
from rt_controller.bus.messages import (
    COMMAND,
    CONTROLLER_IDENTITY,
    FEEDBACK,
    HEARTBEAT,
    MISSION,
    PREVIEW,
    REFERENCE,
    STATE,
    VEHICLE_IDENTITY,
    Command,
    Heartbeat,
    Identity,
    Message,
    Mission,
    StateSample,
)
from rt_controller.contract.faults import Fault
from rt_controller.contract.signals import (
    ControlInput,
    CurvaturePreview,
    Mode,
    PathReference,
    VehicleState,
)

T = TypeVar("T")

SAMPLE = StateSample(
    VehicleState(20.0, 0.5, -0.1, 0.5, 0.25, 0.01), 0.001, 25_000_000, 6, is_watchdog_braking=False
)
PATH = PathReference(1.0, 0.02, 0.001, 2e-5, 22.0, 0.5)
BEND = CurvaturePreview(3.0, 0.001, 0.002, 0.003, 0.004, 0.005)
CONTROL = ControlInput(0.5, 0.0, 0.0)
ENGAGED = Mission(True, False, 4, 300_000_000)
HOLDING = Heartbeat(Mode.HOLD_PLAN, Fault.SOLVER_FAILED, 77, 500_000, 1_000_000, 30)
CONTENTS: dict[Message[Any], Any] = {
    COMMAND: Command(CONTROL, Mode.NOMINAL),
    HEARTBEAT: HOLDING,
    STATE: SAMPLE,
    REFERENCE: PATH,
    PREVIEW: BEND,
    MISSION: ENGAGED,
    FEEDBACK: CONTROL,
    CONTROLLER_IDENTITY: Identity(1, 2),
    VEHICLE_IDENTITY: Identity(1, None),
}


def can_frame(codec: FrameCodec, data: bytes) -> can.Message:
    """One frame as it comes from the bus."""
    return can.Message(
        arbitration_id=codec.arbitration_id, is_extended_id=False, data=data, check=True
    )


def can_frames(
    message: Message[T], content: T, counter: int = 0, is_valid: bool = True
) -> list[can.Message]:
    """All frames of one message."""
    encoded = encode_frames(message, content, counter, is_valid)
    return [can_frame(codec, data) for codec, data in zip(message.codecs, encoded, strict=True)]


def encode_frames(
    message: Message[T], content: T, counter: int, is_valid: bool = True
) -> list[bytes]:
    """One protected frame for each codec, all with this counter."""
    values = message.values_of(content)
    return [c.write(values[part], counter, is_valid) for c, part in message.parts]


def decode_frames(message: Message[T], *frames: Frame) -> T | None:
    """The content of intact frames, one for each codec; None if one must not be used."""
    parts = [codec.read(frame) for codec, frame in zip(message.codecs, frames, strict=True)]
    usable = [part for part in parts if part is not None]
    return message.decode(usable) if len(usable) == len(parts) else None


def round_trip(message: Message[T], content: T, is_valid: bool = True) -> T | None:
    """The content after encoding and decoding."""
    return decode_frames(message, *encode_frames(message, content, 3, is_valid))


class RecordedFrames:
    """Recorder that keeps all frames in memory.

    Arrival time in ns, number and data of each frame, by copy, in order.
    """

    def __init__(self) -> None:
        self.frames: list[tuple[int, int, bytes]] = []

    def record(self, message: can.Message, timestamp_ns: int, is_sent: bool = False) -> None:
        self.frames.append((timestamp_ns, message.arbitration_id, bytes(message.data)))

    def of(self, codec: FrameCodec) -> list[bytes]:
        """The data of the frames of one codec."""
        return [data for _, number, data in self.frames if number == codec.arbitration_id]
