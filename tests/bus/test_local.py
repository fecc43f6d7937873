"""The bus between processes of one machine."""

import os
import shutil
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


def test_a_newcomer_hears_nothing_of_before_and_is_heard_from_its_first_frame_on(join, monkeypatch):
    one = join()
    one.send(frame(1))
    other = join()
    assert other.recv(0.0) is None
    monkeypatch.setattr(local, "REFRESH_NS", 50_000_000)
    one.recv(0.0)  # has looked, and will not look again for a while
    late = join()
    late.send(frame(2))
    assert one.recv(0.0) is None
    assert one.recv(1.0).arbitration_id == 2


def test_frames_of_several_are_heard_in_the_order_they_were_sent(join):
    listener, one, other = join(), join(), join()
    for number in range(20):
        (one if number % 3 else other).send(frame(number))
    assert [listener.recv(0.0).arbitration_id for _ in range(20)] == list(range(20))


def test_who_sleeps_too_long_loses_the_oldest_frames_and_goes_on(join):
    one, other = join(), join()
    assert other.recv(0.0) is None
    for number in range(SLOTS + 100):
        one.send(frame(number % 0x700))
    heard = []
    while (message := other.recv(0.0)) is not None:
        heard.append(message.arbitration_id)
    assert len(heard) == SLOTS // 2
    assert heard[-1] == (SLOTS + 99) % 0x700


def test_filters_hold_for_those_who_wait_and_those_who_do_not(join):
    one, other = join(), join()
    other.set_filters([{"can_id": 0x10, "can_mask": 0x7FF, "extended": False}])
    for _ in range(2):
        one.send(frame(0x11))
        one.send(frame(0x10))
    assert other.recv(0.0).arbitration_id == 0x10
    assert other.recv(1.0).arbitration_id == 0x10
    assert other.recv(0.0) is None


def test_what_is_no_ring_is_passed_over(join):
    bus, other = join(), join()
    (bus._folder / "notes.txt").write_text("gone: no such process")
    (bus._folder / f"{os.getpid()}.1").write_bytes(bytes(200_000))
    other.send(frame(7))
    assert bus.recv(0.0).arbitration_id == 7
    assert not (bus._folder / "notes.txt").exists()


def test_the_last_frames_of_one_who_leaves_are_heard(join):
    bus, other = join(), join()
    other.send(frame(1))
    assert bus.recv(1.0).arbitration_id == 1
    other.send(frame(2))
    close_bus(other)
    assert len([*bus._folder.iterdir()]) == 1  # its ring is gone
    assert bus.recv(1.0).arbitration_id == 2


def test_who_says_something_and_leaves_at_once_is_heard(join, monkeypatch):
    monkeypatch.setattr(local, "REFRESH_NS", 50_000_000)
    bus = join()
    bus.recv(0.0)
    brief = subprocess.Popen([sys.executable, "-c", BRIEF, str(bus._folder.parents[1])])
    try:
        assert bus.recv(30.0).arbitration_id == 0x42
        assert brief.wait(10.0) == 0
    finally:
        brief.kill()
        brief.wait()


BRIEF = """
import sys, can
from pathlib import Path
from rt_controller.bus import local
local.SHARED_MEMORY = Path(sys.argv[1])
bus = local.LocalBus("road")
bus.send(can.Message(arbitration_id=0x42, is_extended_id=False, data=bytes(8)))
bus.shutdown()
"""


def test_the_ring_of_one_who_was_killed_is_cleared_away(join):
    bus = join("lane")
    killed = subprocess.Popen([sys.executable, "-c", LASTING, str(bus._folder.parents[1])])
    home = bus._folder.parent
    try:
        until = time.monotonic() + 30.0
        while time.monotonic() < until and not list((home / "road").glob("*")):
            time.sleep(0.02)
        join("elsewhere")  # whoever comes sweeps, and takes nothing from the living
        (ring,) = (home / "road").iterdir()
        assert ring.name.startswith(f"{killed.pid}.")
    finally:
        killed.kill()
        killed.wait()
    join("somewhere")
    assert not (home / "road").exists()


LASTING = """
import sys, time
from pathlib import Path
from rt_controller.bus import local
local.SHARED_MEMORY = Path(sys.argv[1])
bus = local.LocalBus("road")
time.sleep(60.0)
"""


def test_nothing_is_left_when_all_have_left(join):
    one, other = join(), join()
    folder = one._folder
    close_bus(one)
    assert folder.exists()
    close_bus(other)
    assert not folder.exists()


def test_a_folder_that_was_cleared_away_is_made_again(join):
    one, other = join(), join()
    shutil.rmtree(one._folder.parent)
    for bus in (one, other, one, other):
        bus.recv(0.0)
    late = join()
    for bus, number in ((one, 2), (other, 3), (late, 4)):
        bus.send(frame(number))
    for bus, own in ((one, 2), (other, 3), (late, 4)):
        heard = {bus.recv(1.0).arbitration_id for _ in range(2)}
        assert heard == {2, 3, 4} - {own}


def test_a_change_in_the_same_tick_of_a_coarse_clock_is_seen(join):
    """Some file systems stamp folders to ten milliseconds."""
    one = join()
    seen = one._folder.stat()
    assert one.recv(0.0) is None
    two = join()
    os.utime(one._folder, ns=(seen.st_atime_ns, seen.st_mtime_ns))
    two.send(frame(9))
    assert one.recv(1.0).arbitration_id == 9


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
        "import sys\n"
        "from pathlib import Path\n"
        "from rt_controller.bus import local\n"
        "from rt_controller.bus.transport import open_bus\n"
        "local.SHARED_MEMORY = Path(sys.argv[1])\n"
        "bus = open_bus('local', 'road')\n"
        "heard = bus.recv(20.0)\n"
        "bus.send(heard)\n"
        "bus.shutdown()\n"
    )
    process = subprocess.Popen([sys.executable, "-c", program, str(bus._folder.parents[1])])
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
