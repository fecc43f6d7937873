"""The bus between processes of one machine."""

import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator

import can
import pytest

from rt_controller.bus import local
from rt_controller.bus.local import FRAME, HOST, LocalBus
from rt_controller.bus.transport import close_bus, open_bus


@pytest.fixture
def join(tmp_path, monkeypatch) -> Iterator[Callable[..., can.BusABC]]:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    monkeypatch.setattr(local, "REFRESH_NS", 0)
    buses: list[can.BusABC] = []

    def open_one(channel: str = "road") -> can.BusABC:
        buses.append(open_bus("local", channel))
        return buses[-1]

    yield open_one
    for bus in buses:
        close_bus(bus)


def frame(number: int, length: int = 8, **kind: bool) -> can.Message:
    data = bytes(range(length)) if not kind.get("is_remote_frame") else None
    return can.Message(
        arbitration_id=number, dlc=length, data=data, **{"is_extended_id": False, **kind}
    )


@pytest.mark.parametrize(
    "sent",
    [
        frame(0x123),
        frame(0x7FF, 0),
        frame(0x1ABCDEF0, 3, is_extended_id=True),
        frame(0x20, 4, is_remote_frame=True),
    ],
)
def test_a_frame_arrives_as_it_was_sent(join, sent):
    one, other = join(), join()
    one.send(sent)
    found = other.recv(1.0)
    assert found is not None
    assert found.equals(sent, timestamp_delta=None, check_channel=False, check_direction=False)


def test_everybody_hears_everybody_but_oneself(join):
    buses = [join(), join(), join()]
    for number, bus in enumerate(buses):
        bus.send(frame(number))
    for number, bus in enumerate(buses):
        heard = {bus.recv(1.0).arbitration_id for _ in range(2)}
        assert heard == {0, 1, 2} - {number}
        assert bus.recv(0.0) is None


def test_frames_keep_their_order_and_a_thousand_wait_for_a_sleeper(join):
    one, other = join(), join()
    for number in range(1_000):
        one.send(frame(number))
    assert [other.recv(0.0).arbitration_id for _ in range(1_000)] == list(range(1_000))


def test_channels_do_not_hear_each_other(join):
    one, elsewhere = join("road/1"), join("road%2f1")
    one.send(frame(1))
    assert elsewhere.recv(0.05) is None


def test_nobody_is_heard_who_is_no_member(join):
    bus = join()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.sendto(FRAME.pack(1, 8, bytes(8)), (HOST, bus._address[1]))
        stranger.sendto(b"no frame", (HOST, bus._address[1]))
    assert bus.recv(0.05) is None


def test_what_is_no_frame_of_a_member_hides_none_behind_it(join):
    bus, other = join(), join()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for _ in range(3):
            stranger.sendto(FRAME.pack(1, 8, bytes(8)), (HOST, bus._address[1]))
    other.send(frame(7))
    time.sleep(0.05)
    assert bus.recv(0.0).arbitration_id == 7


def test_the_last_frames_of_one_who_leaves_are_heard(join):
    bus, other = join(), join()
    other.send(frame(1))
    assert bus.recv(1.0).arbitration_id == 1
    other.send(frame(2))
    close_bus(other)
    bus.send(frame(3))  # by now its mark is gone
    assert bus.recv(1.0).arbitration_id == 2


def test_a_folder_that_was_cleaned_away_is_made_again(join):
    one, other = join(), join()
    one.send(frame(1))
    assert other.recv(1.0).arbitration_id == 1
    shutil.rmtree(one._folder)
    for bus, number in ((one, 2), (other, 3), (one, 4), (other, 5)):
        bus.send(frame(number))
    assert {other.recv(1.0).arbitration_id for _ in range(2)} == {2, 4}
    assert {one.recv(1.0).arbitration_id for _ in range(2)} == {3, 5}


def test_who_left_or_died_is_soon_not_sent_to(join, monkeypatch):
    monkeypatch.setattr(local, "FAREWELL_NS", 50_000_000)
    one, other = join(), join()
    assert len(one._members()) == 1
    close_bus(other)
    time.sleep(0.1)
    assert one._members() == []
    dead = subprocess.run(
        [sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True, check=True
    )
    mark = one._folder / "12345"
    mark.write_text(dead.stdout.decode())
    assert one._members() == []
    os.utime(mark, (time.time() - 60, time.time() - 60))
    one._members()
    assert not mark.exists()
    one.send(frame(1))  # into the void, as on a bus without a listener that does not acknowledge


def test_waiting_ends_with_the_first_frame_or_in_time(join):
    one, other = join(), join()
    begun = time.monotonic()
    assert other.recv(0.05) is None
    assert time.monotonic() - begun >= 0.05
    one.send(frame(5))
    assert other.recv(None).arbitration_id == 5


def test_a_closed_bus_says_so(join):
    bus = join()
    join()
    close_bus(bus)
    with pytest.raises(can.CanOperationError):
        bus.recv(0.01)
    with pytest.raises(can.CanOperationError):
        bus.send(frame(1))


def test_frames_of_can_fd_and_unknown_options_are_refused(join):
    with pytest.raises(can.CanOperationError, match="classic"):
        join().send(can.Message(arbitration_id=1, is_fd=True, data=bytes(12)))
    with pytest.raises(can.CanInitializationError, match="speed"):
        LocalBus("road", speed=3)


def test_two_processes_talk(join):
    bus = join()
    program = (
        "from rt_controller.bus.transport import open_bus\n"
        "bus = open_bus('local', 'road')\n"
        "heard = bus.recv(20.0)\n"
        "bus.send(heard)\n"
        "bus.shutdown()\n"
    )
    process = subprocess.Popen([sys.executable, "-c", program], env={**os.environ})
    try:
        answer = None
        until = time.monotonic() + 30.0
        while answer is None and time.monotonic() < until:
            bus.send(frame(0x55))
            answer = bus.recv(0.1)
        assert answer is not None
        assert answer.arbitration_id == 0x55
        assert process.wait(10.0) == 0
    finally:
        process.kill()
        process.wait()
