"""Cost of coding: every frame, the frames of a whole state and path, a command."""

import pytest
from made_frames import CONTROL, PATH, SAMPLE, can_frames
from pytest_benchmark.fixture import BenchmarkFixture

from rt_controller.bus.catalogue import CATALOGUE, COMMAND, REFERENCE, STATE, Command
from rt_controller.bus.codec import FrameCodec
from rt_controller.bus.inbox import Inbox, ReceptionCounts
from rt_controller.bus.message import Node
from rt_controller.bus.outbox import Outbox
from rt_controller.bus.transport import open_bus
from rt_controller.contract.signals import Mode

CODECS = [codec for message in CATALOGUE.messages for codec in message.codecs]
every_frame = pytest.mark.parametrize("codec", CODECS, ids=lambda codec: codec.name)


def _middle(codec: FrameCodec) -> tuple[float, ...]:
    return tuple((s.raw_min + s.raw_max) // 2 * s.scale + s.offset for s in codec.signals)


@every_frame
def test_encode(benchmark: BenchmarkFixture, codec: FrameCodec) -> None:
    frame = benchmark(codec.encode, _middle(codec), 3, 1)
    assert codec.is_intact(frame)


@every_frame
def test_check_and_decode(benchmark: BenchmarkFixture, codec: FrameCodec) -> None:
    values = _middle(codec)
    frame = codec.encode(values, 3, 1)
    decoded = benchmark(lambda: codec.decode(frame) if codec.is_intact(frame) else None)
    assert decoded == pytest.approx(values)


def test_receive_state_and_path(benchmark: BenchmarkFixture) -> None:
    """Five frames, checked and assembled; without the bus."""
    rounds = [
        can_frames(STATE, SAMPLE, counter) + can_frames(REFERENCE, PATH, counter)
        for counter in range(16)
    ]
    inbox = Inbox(Node.CONTROLLER)
    tick = 0

    def receive() -> None:
        nonlocal tick
        for message in rounds[tick % 16]:
            inbox.accept(message, tick)
        tick += 1

    benchmark(receive)
    newest = inbox.newest(STATE)
    assert newest is not None
    assert newest.counter == (tick - 1) % 16
    assert inbox.counts == ReceptionCounts()


def test_send_command(benchmark: BenchmarkFixture) -> None:
    """Encoded and sent to a virtual bus without another member."""
    with open_bus("virtual", "benchmark") as bus:
        outbox = Outbox(bus, Node.CONTROLLER)
        benchmark(lambda: outbox.send(COMMAND, Command(CONTROL, Mode.NOMINAL), 0, counter=0))
        assert outbox.sent > 0
        assert outbox.send_failures == 0
