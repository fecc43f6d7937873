"""The bus between processes of one machine, and damaged files in its folder."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import can
import pytest

from rt_controller.bus import local
from rt_controller.bus.local import LocalBus
from rt_controller.bus.ring import SLOTS
from rt_controller.bus.transport import close_bus, open_bus


@pytest.fixture
def join(tmp_path, monkeypatch) -> Iterator[Callable[..., can.BusABC]]:
    monkeypatch.setattr(local, "SHARED_MEMORY", tmp_path)
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
        frame(0x111, 64, is_fd=True),
        frame(0x112, 12, is_fd=True, bitrate_switch=True, error_state_indicator=True),
    ],
)
def test_a_frame_arrives_as_it_was_sent(join, sent):
    one, other = join(), join()
    one.send(sent)
    found = other.recv(1.0)
    assert found.equals(sent, timestamp_delta=None, check_channel=False, check_direction=False)


def test_frames_keep_their_order_and_a_thousand_wait_for_a_late_reader(join):
    one, other = join(), join()
    for number in range(1_000):
        one.send(frame(number))
    assert [other.recv(0.0).arbitration_id for _ in range(1_000)] == list(range(1_000))


def test_a_new_member_receives_no_older_frames_and_its_first_frame_is_received(join, monkeypatch):
    one = join()
    one.send(frame(1))
    other = join()
    assert other.recv(0.0) is None
    monkeypatch.setattr(local, "REFRESH_NS", 50_000_000)
    one.recv(0.0)  # the folder is not read again for a while
    late = join()
    late.send(frame(2))
    assert one.recv(0.0) is None
    assert one.recv(1.0).arbitration_id == 2


def test_a_reader_that_is_too_late_loses_the_oldest_frames_and_reads_on(join):
    one, other = join(), join()
    assert other.recv(0.0) is None
    for number in range(SLOTS + 100):
        one.send(frame(number % 0x700))
    received = []
    while (message := other.recv(0.0)) is not None:
        received.append(message.arbitration_id)
    assert len(received) == SLOTS // 2
    assert received[-1] == (SLOTS + 99) % 0x700


def test_filters_apply_to_blocking_and_non_blocking_reads(join):
    one, other = join(), join()
    other.set_filters([{"can_id": 0x10, "can_mask": 0x7FF, "extended": False}])
    for _ in range(2):
        one.send(frame(0x11))
        one.send(frame(0x10))
    assert other.recv(0.0).arbitration_id == 0x10
    assert other.recv(1.0).arbitration_id == 0x10
    assert other.recv(0.0) is None


def test_the_last_frames_of_a_member_that_leaves_arrive(join):
    bus, other = join(), join()
    other.send(frame(1))
    assert bus.recv(1.0).arbitration_id == 1
    other.send(frame(2))
    close_bus(other)
    assert len([*bus._folder.iterdir()]) == 1  # its ring is gone
    assert bus.recv(1.0).arbitration_id == 2


def test_the_ring_of_a_killed_process_is_removed(join):
    bus = join("lane")
    killed = subprocess.Popen([sys.executable, "-c", LONG_LIVED, str(bus._folder.parents[1])])
    home = bus._folder.parent
    try:
        until = time.monotonic() + 30.0
        while time.monotonic() < until and not list((home / "road").glob("*")):
            time.sleep(0.02)
        join("elsewhere")  # a new member removes orphans, and nothing of running processes
        (ring,) = (home / "road").iterdir()
        assert ring.name.startswith(f"{killed.pid}.")
    finally:
        killed.kill()
        killed.wait()
    join("somewhere")
    assert not (home / "road").exists()


LONG_LIVED = """
import sys, time
from pathlib import Path
from rt_controller.bus import local
local.SHARED_MEMORY = Path(sys.argv[1])
bus = local.LocalBus("road")
time.sleep(60.0)
"""


def test_a_closed_bus_raises_and_the_last_member_removes_the_folder(join):
    one, other = join(), join()
    folder = one._folder
    close_bus(one)
    for use in (lambda: one.recv(0.01), lambda: one.send(frame(1))):
        with pytest.raises(can.CanOperationError):
            use()
    assert folder.exists()
    close_bus(other)
    assert not folder.exists()


def test_frames_that_are_too_long_and_unknown_options_are_refused(join):
    for longest, is_fd in ((8, False), (64, True)):
        with pytest.raises(can.CanOperationError, match=f"expected {longest} bytes at most"):
            join().send(can.Message(arbitration_id=1, is_fd=is_fd, data=bytes(longest + 1)))
    with pytest.raises(can.CanInitializationError, match="speed"):
        LocalBus("road", speed=3)


def test_whatever_else_is_in_the_folder_blocks_no_member(join, tmp_path):
    near, far = join(), join()
    near.recv(0)
    os.mkfifo(near._folder / "pipe")
    os.mkfifo(near._folder.parent / "pipe")
    (near._folder / "folder").mkdir()
    (near._folder / "notes.txt").write_text("gone: no such process")
    (near._folder / f"{os.getpid()}.1").write_bytes(bytes(200_000))
    (near._folder / "link").symlink_to("/dev/zero")
    far.send(frame(0x123))
    assert near.recv(0).arbitration_id == 0x123
    late = join()
    late.send(frame(0x124))
    assert near.recv(0).arbitration_id == 0x124


@pytest.mark.parametrize("size", [0, 20])
def test_a_truncated_ring_ends_neither_its_readers_nor_its_writer(join, size):
    near, far = join(), join()
    near.recv(0)
    far.send(frame(0x123))
    os.truncate(far._ring.path, size)
    received = near.recv(0)
    assert received is None or received.arbitration_id == 0x123
    far.send(frame(0x124))
    near.recv(0)
    third = join()
    third.send(frame(0x125))
    while (received := near.recv(0)) is not None and received.arbitration_id != 0x125:
        pass
    assert received is not None


@pytest.mark.parametrize("count", [0, 2**64 - 1])
def test_a_ring_with_a_senseless_count_is_read_for_a_limited_time(join, count):
    near, far = join(), join()
    near.recv(0)
    for number in range(10):
        far.send(frame(number))
    assert near.recv(0).arbitration_id == 0
    with far._ring.path.open("r+b") as file:
        file.seek(8)
        file.write(count.to_bytes(8, sys.byteorder))
    n_frames = 0
    while near.recv(0) is not None:
        n_frames += 1
    assert n_frames <= SLOTS
