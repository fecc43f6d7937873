"""Files in the folder of a local bus that are damaged, or are no rings."""

import os
import sys

import can
import pytest

from rt_controller.bus.ring import SLOTS


def frame(number: int) -> can.Message:
    return can.Message(arbitration_id=number, is_extended_id=False, data=bytes(8))


def test_files_that_are_not_rings_are_ignored(join):
    bus, other = join(), join()
    (bus._folder / "notes.txt").write_text("gone: no such process")
    (bus._folder / f"{os.getpid()}.1").write_bytes(bytes(200_000))
    other.send(frame(7))
    assert bus.recv(0.0).arbitration_id == 7
    assert not (bus._folder / "notes.txt").exists()


def test_pipes_folders_and_links_in_the_folder_block_no_member(join, tmp_path):
    near, far = join(), join()
    near.recv(0)
    os.mkfifo(near._folder / "pipe")
    os.mkfifo(near._folder.parent / "pipe")
    (near._folder / "folder").mkdir()
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
