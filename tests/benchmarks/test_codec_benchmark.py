"""What coding costs: every message, a whole snapshot in, a command out."""

import can
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from rt_controller.bus import frames
from rt_controller.bus.codec import MessageCodec
from rt_controller.bus.frames import RoadSample
from rt_controller.bus.inbox import Inbox
from rt_controller.bus.outbox import ControllerOutbox
from rt_controller.bus.transport import open_bus
from rt_controller.contract.signals import ControlInput, Mode, PathReference, VehicleState

STATE = VehicleState(22.2, 0.3, 0.1, 0.555, -0.2, 0.01)
ROAD = RoadSample(0.001, 123_400_000, 3, False)
PATH = PathReference(1.0, 0.02, 0.001, 2e-5, 22.0, 0.5)
CONTROL = ControlInput(0.3, 0.0, 0.1)

every_message = pytest.mark.parametrize("codec", frames.CODECS, ids=lambda codec: codec.name)


def _middle(codec: MessageCodec) -> tuple[float, ...]:
    return tuple((s.raw_min + s.raw_max) // 2 * s.scale for s in codec.signals)


@every_message
def test_encode(benchmark: BenchmarkFixture, codec: MessageCodec) -> None:
    values = _middle(codec)
    frame = benchmark(codec.encode, values, 3, 1)
    assert codec.is_intact(frame)


@every_message
def test_check_and_decode(benchmark: BenchmarkFixture, codec: MessageCodec) -> None:
    values = _middle(codec)
    frame = codec.encode(values, 3, 1)
    decoded = benchmark(lambda: codec.decode(frame) if codec.is_intact(frame) else None)
    assert decoded == pytest.approx(values)


def test_encode_command(benchmark: BenchmarkFixture) -> None:
    frame = benchmark(frames.encode_command, CONTROL, Mode.NOMINAL, 3)
    assert frames.ACT_CMD.is_intact(frame)


def test_decode_three_state_frames(benchmark: BenchmarkFixture) -> None:
    a = frames.encode_state_a(STATE, 3)
    b = frames.encode_state_b(STATE, 3)
    c = frames.encode_state_c(ROAD, 3)
    first, _, third = benchmark(
        lambda: (frames.decode_state_a(a), frames.decode_state_b(b), frames.decode_state_c(c))
    )
    assert first == pytest.approx(STATE[:3])
    assert third == ROAD


def test_snapshot_in(benchmark: BenchmarkFixture) -> None:
    """Five frames of state and reference, checked and assembled; without the bus."""
    rounds = [
        [
            can.Message(
                arbitration_id=codec.arbitration_id, is_extended_id=False, data=frame, check=True
            )
            for codec, frame in (
                (frames.STATE_A, frames.encode_state_a(STATE, counter)),
                (frames.STATE_B, frames.encode_state_b(STATE, counter)),
                (frames.STATE_C, frames.encode_state_c(ROAD, counter)),
                (frames.REF_PATH, frames.encode_reference_path(PATH, counter)),
                (frames.REF_SPEED, frames.encode_reference_speed(PATH, counter)),
            )
        ]
        for counter in range(16)
    ]
    inbox = Inbox()
    tick = 0

    def receive() -> None:
        nonlocal tick
        for message in rounds[tick % 16]:
            inbox.accept(message, tick)
        tick += 1

    benchmark(receive)
    assert inbox.state is not None
    assert inbox.state.counter == (tick - 1) % 16
    assert sum(inbox.counts) == 0


def test_command_out(benchmark: BenchmarkFixture) -> None:
    """Encoded and handed to a virtual bus on which nobody else listens."""
    with open_bus("virtual", "benchmark") as bus:
        outbox = ControllerOutbox(bus)
        benchmark(outbox.send_command, CONTROL, Mode.NOMINAL, 0, 0)
        assert outbox.sent > 0
        assert outbox.send_failures == 0
