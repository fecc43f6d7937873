"""Cost of coding: every frame, the frames of a whole state and path, a command."""

import pytest
from made_frames import CONTROL, PATH, SAMPLE, can_frames
from pytest_benchmark.fixture import BenchmarkFixture

from rt_controller.bus.codec import FrameCodec
from rt_controller.bus.messages import CATALOGUE, COMMAND, REFERENCE, STATE, Command, Node
from rt_controller.bus.receive import Inbox, ReceptionCounts
from rt_controller.bus.send import Outbox
from rt_controller.bus.transport import open_bus
from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import PERIOD_NS

CODECS = [codec for message in CATALOGUE.messages for codec in message.codecs]
every_frame = pytest.mark.parametrize("codec", CODECS, ids=lambda codec: codec.name)


def _middle(codec: FrameCodec) -> tuple[float, ...]:
    return tuple((s.raw_min + s.raw_max) // 2 * s.scale + s.offset for s in codec.signals)


@every_frame
def test_encode(benchmark: BenchmarkFixture, codec: FrameCodec) -> None:
    frame = benchmark(codec.encode, _middle(codec), 3, 1)
    assert codec.check(frame) >= 0


@every_frame
def test_check_and_decode(benchmark: BenchmarkFixture, codec: FrameCodec) -> None:
    values = _middle(codec)
    frame = codec.encode(values, 3, 1)
    decoded = benchmark(lambda: codec.decode(frame) if (codec.check(frame) >= 0) else None)
    assert decoded == pytest.approx(values)


def test_receive_state_and_path(benchmark: BenchmarkFixture) -> None:
    """Five frames, checked and assembled; without the bus."""
    rounds = [
        can_frames(STATE, SAMPLE, counter) + can_frames(REFERENCE, PATH, counter)
        for counter in range(128)
    ]
    inbox = Inbox(Node.CONTROLLER)
    tick = 0

    def receive() -> None:
        nonlocal tick
        for message in rounds[tick % 128]:
            inbox.accept(message, tick)
        tick += 1

    benchmark(receive)
    newest = inbox.newest(STATE)
    assert newest is not None
    assert newest.counter == (tick - 1) % 128
    assert inbox.counts == ReceptionCounts()


def test_check_links_and_sources_of_a_tick(benchmark: BenchmarkFixture) -> None:
    """What a controller's tick adds to receiving; the sequence check is a part of receiving."""
    inbox = Inbox(Node.CONTROLLER)
    for counter in range(3):
        for message in can_frames(STATE, SAMPLE, counter) + can_frames(REFERENCE, PATH, counter):
            inbox.accept(message, counter * PERIOD_NS)
    now_ns = 2 * PERIOD_NS

    def check() -> bool:
        contents = [inbox.newest_valid(message, now_ns) for message in (STATE, REFERENCE)]
        inbox._period_ns = now_ns  # the frames above are those of this period
        inbox.end_period(now_ns)
        return all(contents) and not inbox.has_conflict(STATE, now_ns)

    assert benchmark(check)


def test_send_command(benchmark: BenchmarkFixture) -> None:
    """Encoded and sent to a virtual bus without another member."""
    with open_bus("virtual", "benchmark") as bus:
        outbox = Outbox(bus, Node.CONTROLLER)
        benchmark(lambda: outbox.send(COMMAND, Command(CONTROL, Mode.NOMINAL), 0, counter=0))
        assert outbox.sent > 0
        assert outbox.send_failures == 0
