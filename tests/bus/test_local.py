"""The bus between processes of one machine."""

import shutil
import subprocess
import sys
import time

import can
import pytest

from rt_controller.bus import local
from rt_controller.bus.local import LocalBus
from rt_controller.bus.ring import SLOTS
from rt_controller.bus.transport import close_bus


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
    assert found is not None
    assert found.equals(sent, timestamp_delta=None, check_channel=False, check_direction=False)


def test_every_member_receives_the_frames_of_all_others_only(join):
    buses = [join(), join(), join()]
    for number, bus in enumerate(buses):
        bus.send(frame(number))
    for number, bus in enumerate(buses):
        received = {bus.recv(1.0).arbitration_id for _ in range(2)}
        assert received == {0, 1, 2} - {number}
        assert bus.recv(0.0) is None


def test_frames_keep_their_order_and_a_thousand_wait_for_a_late_reader(join):
    one, other = join(), join()
    for number in range(1_000):
        one.send(frame(number))
    assert [other.recv(0.0).arbitration_id for _ in range(1_000)] == list(range(1_000))


def test_channels_are_separate(join):
    one, elsewhere = join("road/1"), join("road%2f1")
    one.send(frame(1))
    assert elsewhere.recv(0.05) is None


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


def test_frames_of_several_members_arrive_in_the_order_of_sending(join):
    listener, one, other = join(), join(), join()
    for number in range(20):
        (one if number % 3 else other).send(frame(number))
    assert [listener.recv(0.0).arbitration_id for _ in range(20)] == list(range(20))


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


def test_frames_of_a_member_that_leaves_at_once_arrive(join, monkeypatch):
    monkeypatch.setattr(local, "REFRESH_NS", 50_000_000)
    bus = join()
    bus.recv(0.0)
    brief = subprocess.Popen([sys.executable, "-c", BRIEF, str(bus._folder.parents[1])])
    try:
        assert bus.recv(90.0).arbitration_id == 0x42
        assert brief.wait(10.0) == 0
    finally:
        brief.kill()
        brief.wait()


BRIEF = """
import sys, can
from pathlib import Path
from rt_controller.bus import local
local.SHARED_MEMORY = Path(sys.argv[1])
local.REFRESH_NS = 300_000_000  # time for a receiver that the machine keeps waiting
bus = local.LocalBus("road")
bus.send(can.Message(arbitration_id=0x42, is_extended_id=False, data=bytes(8)))
bus.shutdown()
"""


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


def test_the_last_member_removes_the_folder(join):
    one, other = join(), join()
    folder = one._folder
    close_bus(one)
    assert folder.exists()
    close_bus(other)
    assert not folder.exists()


def test_a_folder_that_was_removed_is_made_again(join):
    one, other = join(), join()
    shutil.rmtree(one._folder.parent)
    for bus in (one, other, one, other):
        bus.recv(0.0)
    late = join()
    for bus, number in ((one, 2), (other, 3), (late, 4)):
        bus.send(frame(number))
    for bus, own in ((one, 2), (other, 3), (late, 4)):
        received = {bus.recv(1.0).arbitration_id for _ in range(2)}
        assert received == {2, 3, 4} - {own}


def test_a_blocking_read_ends_with_the_first_frame_or_at_its_timeout(join):
    one, other = join(), join()
    begun = time.monotonic()
    assert other.recv(0.05) is None
    assert time.monotonic() - begun >= 0.05
    one.send(frame(5))
    assert other.recv(None).arbitration_id == 5


def test_a_closed_bus_raises(join):
    bus = join()
    join()
    close_bus(bus)
    with pytest.raises(can.CanOperationError):
        bus.recv(0.01)
    with pytest.raises(can.CanOperationError):
        bus.send(frame(1))


def test_frames_that_are_too_long_and_unknown_options_are_refused(join):
    for longest, is_fd in ((8, False), (64, True)):
        with pytest.raises(can.CanOperationError, match=f"expected {longest} bytes at most"):
            join().send(can.Message(arbitration_id=1, is_fd=is_fd, data=bytes(longest + 1)))
    with pytest.raises(can.CanInitializationError, match="speed"):
        LocalBus("road", speed=3)


def test_a_notifier_that_joins_later_passes_frames_to_its_listeners(join):
    sender = join()
    sender.send(frame(1))
    received = can.BufferedReader()
    with can.Notifier(join(), [received], timeout=0.05):
        sender.send(frame(2))
        assert received.get_message(5.0).arbitration_id == 2
