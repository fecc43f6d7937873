"""Which frames are admitted, and that every other one is counted."""

import can
import pytest

from rt_controller.bus import frames
from rt_controller.bus.codec import Frame
from rt_controller.bus.reception import MAX_FRAMES_PER_DRAIN, Reception, ReceptionCounts
from rt_controller.bus.transport import open_bus
from rt_controller.contract.signals import ControlInput, Mode

NO_TROUBLE = ReceptionCounts(0, 0, 0, 0, 0, 0)


class Listener:
    """Keeps the counters of the frames it was handed."""

    def __init__(self, verdict: bool = True) -> None:
        self.counters: list[int] = []
        self.arrivals_ns: list[int] = []
        self._verdict = verdict

    def take(self, frame: Frame, counter: int, arrival_ns: int) -> bool:
        self.counters.append(counter)
        self.arrivals_ns.append(arrival_ns)
        return self._verdict


def command(counter: int, throttle: float = 0.2) -> can.Message:
    control = ControlInput(throttle, 0.0, 0.1)
    return can.Message(
        arbitration_id=frames.ACT_CMD.arbitration_id,
        is_extended_id=False,
        data=frames.encode_command(control, Mode.NOMINAL, counter),
        check=True,
    )


def listening(verdict: bool = True) -> tuple[Listener, Reception]:
    listener = Listener(verdict)
    return listener, Reception({frames.ACT_CMD: listener.take}, None)


def test_consecutive_counters_are_admitted_also_across_the_wrap() -> None:
    listener, reception = listening()
    for tick in range(40):
        reception.accept(command(tick % 16), tick)
    assert listener.counters == [tick % 16 for tick in range(40)]
    assert reception.counts == NO_TROUBLE


def test_the_first_frame_may_have_any_counter() -> None:
    listener, reception = listening()
    reception.accept(command(11), 0)
    assert listener.counters == [11]
    assert reception.counts == NO_TROUBLE


@pytest.mark.parametrize("bit", [0, 7, 12, 20, 63])
def test_a_damaged_frame_is_dropped_and_counted(bit: int) -> None:
    listener, reception = listening()
    message = command(0)
    message.data[bit // 8] ^= 1 << bit % 8
    reception.accept(message, 0)
    assert listener.counters == []
    assert reception.counts == NO_TROUBLE._replace(crc_errors=1)


@pytest.mark.parametrize("length", [0, 1, 7])
def test_a_short_frame_is_dropped_and_counted(length: int) -> None:
    listener, reception = listening()
    message = command(0)
    del message.data[length:]
    reception.accept(message, 0)
    assert listener.counters == []
    assert reception.counts == NO_TROUBLE._replace(crc_errors=1)


def test_a_repeated_counter_is_dropped_and_counted() -> None:
    """A sender that repeats itself is stuck, whatever it says."""
    listener, reception = listening()
    reception.accept(command(3), 0)
    reception.accept(command(3), 1)
    reception.accept(command(3, throttle=0.9), 2)
    assert listener.counters == [3]
    assert reception.counts == NO_TROUBLE._replace(repeated=2)


@pytest.mark.parametrize(("counter", "lost"), [(4, 0), (5, 1), (7, 3), (2, 14)])
def test_gaps_in_the_counters_are_counted_as_lost_frames(counter: int, lost: int) -> None:
    listener, reception = listening()
    reception.accept(command(3), 0)
    reception.accept(command(counter), 1)
    assert listener.counters == [3, counter]
    assert reception.counts == NO_TROUBLE._replace(lost=lost)


def test_a_frame_whose_values_are_refused_is_counted_as_out_of_range() -> None:
    _, reception = listening(verdict=False)
    reception.accept(command(3), 0)
    assert reception.counts == NO_TROUBLE._replace(out_of_range=1)


def test_a_damaged_frame_does_not_move_the_counter() -> None:
    listener, reception = listening()
    reception.accept(command(3), 0)
    damaged = command(9)
    damaged.data[5] ^= 1
    reception.accept(damaged, 1)
    reception.accept(command(4), 2)
    assert listener.counters == [3, 4]
    assert reception.counts == NO_TROUBLE._replace(crc_errors=1)


def test_frames_that_only_look_like_ours_are_ignored() -> None:
    listener, reception = listening()
    extended = command(0)
    extended.is_extended_id = True
    remote = command(0)
    remote.is_remote_frame = True
    other = command(0)
    other.arbitration_id = 0x555
    for message in (extended, remote, other):
        reception.accept(message, 0)
    assert listener.counters == []
    assert reception.counts == NO_TROUBLE


def test_error_frames_are_counted() -> None:
    listener, reception = listening()
    error = command(0)
    error.is_error_frame = True
    reception.accept(error, 0)
    assert listener.counters == []
    assert reception.counts == NO_TROUBLE._replace(error_frames=1)


def test_draining_reads_all_that_waits_and_stamps_it_with_the_time_given() -> None:
    listener, reception = listening()
    with open_bus("virtual", "drain") as near, open_bus("virtual", "drain") as far:
        for counter in range(5):
            far.send(command(counter), timeout=0)
        assert reception.drain(near, 777) == 5
        assert reception.drain(near, 888) == 0
    assert listener.counters == [0, 1, 2, 3, 4]
    assert listener.arrivals_ns == [777] * 5


def test_a_flooded_bus_does_not_hold_up_the_step() -> None:
    _, reception = listening()
    with open_bus("virtual", "flood") as near, open_bus("virtual", "flood") as far:
        for tick in range(MAX_FRAMES_PER_DRAIN + 10):
            far.send(command(tick % 16), timeout=0)
        assert reception.drain(near, 0) == MAX_FRAMES_PER_DRAIN
        assert reception.drain(near, 1) == 10


def test_a_bus_that_fails_is_counted_and_explained_but_raises_nothing() -> None:
    _, reception = listening()
    bus = open_bus("virtual", "closed")
    bus.shutdown()
    assert reception.drain(bus, 0) == 0
    assert reception.drain(bus, 1) == 0
    assert reception.counts == NO_TROUBLE._replace(receive_failures=2)
    assert "closed" in reception.last_failure
