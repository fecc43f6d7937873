"""Frames, error frames, overflow and link of a real kernel, as the controller's bus sees them."""

import os
import pty
import subprocess
import time
import tty

import can
import pytest
from kernel_bus import CHANNEL, drain_frames, switch
from made_frames import CONTROL, SAMPLE

from rt_controller.bus.condition import BusState
from rt_controller.bus.messages import COMMAND, STATE, Command, Node
from rt_controller.bus.receive import Inbox
from rt_controller.bus.send import Outbox
from rt_controller.bus.transport import open_bus
from rt_controller.contract.signals import Mode

NOMINAL = Command(CONTROL, Mode.NOMINAL)


def error_frame(classes: int, detail: int = 0) -> can.Message:
    data = bytes((0, detail, 0, 0, 0, 0, 0, 0))
    return can.Message(arbitration_id=classes, is_extended_id=False, is_error_frame=True, data=data)


def test_a_command_arrives_bit_by_bit(near: can.BusABC, far: can.BusABC) -> None:
    inbox = Inbox(Node.VEHICLE)
    Outbox(near, Node.CONTROLLER).send(COMMAND, NOMINAL, 0)
    drain_frames(inbox, far, len(COMMAND.codecs))
    received = inbox.newest(COMMAND)
    assert received is not None
    assert received.content.mode is Mode.NOMINAL
    assert inbox.foreign_frames == 0


def test_a_frame_that_one_sent_does_not_come_back(near: can.BusABC) -> None:
    Outbox(near, Node.CONTROLLER).send(COMMAND, NOMINAL, 0)
    assert near.recv(0) is None


def test_the_c_tools_read_what_is_sent(near: can.BusABC, foreign_log) -> None:
    time.sleep(0.5)
    outbox = Outbox(near, Node.VEHICLE)
    outbox.send(STATE, SAMPLE, 0)
    lines = [foreign_log.stdout.readline() for _ in STATE.codecs]
    ids = {line.split()[-1].partition("#")[0] for line in lines}
    assert ids == {f"{codec.arbitration_id:03X}" for codec in STATE.codecs}


@pytest.mark.parametrize("frame", ["555#0011", "18DAF110#0210", "7FF#R", "100#00"])
def test_frames_of_a_foreign_program_are_no_commands(near: can.BusABC, frame: str) -> None:
    """100 is the id of the command: without its checksum the frame is dropped and counted."""
    inbox = Inbox(Node.VEHICLE)
    subprocess.run(["cansend", CHANNEL, frame], check=True)
    assert drain_frames(inbox, near, 1) == 1
    assert inbox.newest(COMMAND) is None
    assert inbox.counts.crc_errors == (frame == "100#00")


def test_64_bytes_of_can_fd_pass_beside_the_classic_frames() -> None:
    fd = {"fd": True}
    with (
        open_bus("socketcan", CHANNEL, options=fd) as one,
        open_bus("socketcan", CHANNEL, options=fd) as other,
        open_bus("socketcan", CHANNEL) as classic,
    ):
        data = bytes(range(64))
        frame = can.Message(
            arbitration_id=0x123, is_extended_id=False, is_fd=True, bitrate_switch=True, data=data
        )
        one.send(frame, timeout=0)
        received = other.recv(1.0)
        assert received is not None
        assert (received.is_fd, bytes(received.data)) == (True, data)
        assert classic.recv(0) is None
        subprocess.run(["cansend", CHANNEL, "124##1" + "AB" * 64], check=True)
        received = other.recv(1.0)
        assert received is not None
        assert bytes(received.data) == b"\xab" * 64


def test_the_way_into_bus_off_and_out_of_it(near: can.BusABC, far: can.BusABC) -> None:
    inbox = Inbox(Node.CONTROLLER)
    for classes, detail, state in (
        (0x004, 0x08, BusState.WARNING),
        (0x004, 0x20, BusState.PASSIVE),
        (0x040, 0x00, BusState.BUS_OFF),
        (0x100, 0x00, BusState.ACTIVE),
    ):
        far.send(error_frame(classes, detail), timeout=0)
        drain_frames(inbox, near, 1)
        assert inbox.condition.state is state
    assert (inbox.condition.bus_off, inbox.condition.restarts) == (1, 1)
    assert inbox.last_failure == ""


def test_frames_that_overflow_the_receive_buffer_are_counted(
    near: can.BusABC, far: can.BusABC
) -> None:
    inbox, n_frames = Inbox(Node.CONTROLLER), 6000
    frame = can.Message(arbitration_id=0x7FF, is_extended_id=False)
    for _ in range(n_frames):
        far.send(frame, timeout=0)
    read = 0
    while count := inbox.drain(near, 0):
        read += count
    assert 278 < read < n_frames
    assert inbox.counts.overflowed == n_frames - read


def test_a_link_that_goes_down_is_told_and_recovers(near: can.BusABC, far: can.BusABC) -> None:
    inbox, outbox = Inbox(Node.CONTROLLER), Outbox(near, Node.CONTROLLER)
    vehicle = Outbox(far, Node.VEHICLE)
    switch("down")
    try:
        inbox.drain(near, 0)
        outbox.send(COMMAND, NOMINAL, 0)
        assert inbox.condition.state is BusState.DOWN
        assert (outbox.send_failures, outbox.queue_full) == (1, 0)
        assert "down" in outbox.last_failure
    finally:
        switch("up")
    Inbox(Node.VEHICLE).drain(far, 1)  # each socket is told once, by its next call
    vehicle.send(STATE, SAMPLE, 1)
    drain_frames(inbox, near, len(STATE.codecs), 1)
    assert inbox.newest(STATE) is not None
    assert inbox.condition.state is BusState.ACTIVE
    inbox.require_readable()
    outbox.send(COMMAND, NOMINAL, 1)
    assert outbox.send_failures == 1


def test_an_interface_that_is_removed_is_a_failure() -> None:
    subprocess.run(["ip", "link", "add", "vcan9", "type", "vcan"], check=True)
    subprocess.run(["ip", "link", "set", "vcan9", "up"], check=True)
    with open_bus("socketcan", "vcan9") as bus:
        inbox = Inbox(Node.CONTROLLER)
        subprocess.run(["ip", "link", "del", "vcan9"], check=True)
        for now_ns in range(3):
            inbox.drain(bus, now_ns)
        assert inbox.last_failure


def test_a_full_queue_is_told_from_a_link_that_is_down() -> None:
    """A pseudo terminal whose other end is not read takes a few frames and then no more."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    attached = subprocess.Popen(["slcand", "-o", "-F", os.ttyname(theirs), "slcan7"])
    try:
        for _ in range(50):
            if subprocess.run(["ip", "link", "set", "slcan7", "up"], check=False).returncode == 0:
                break
            time.sleep(0.1)
        with open_bus("socketcan", "slcan7") as bus:
            outbox = Outbox(bus, Node.CONTROLLER)
            for now_ns in range(3000):
                outbox.send(COMMAND, NOMINAL, now_ns)
                if outbox.send_failures:
                    break
            assert (outbox.queue_full, outbox.send_failures) == (1, 1)
    finally:
        attached.terminate()
        attached.wait()
        os.close(ours)
        os.close(theirs)
