"""The simulated car with its own messages takes commands as the contract sends them."""

from collections import deque

import can
import pytest
from made_frames import SAMPLE
from own_car import command_writer, example

from rt_controller.bus.messages import COMMAND, STATE, Node
from rt_controller.bus.receive import Inbox
from rt_controller.bus.send import Outbox
from rt_controller.contract.signals import Mode
from sim_bridge.foreign_bus import ForeignBus


class Wire(can.BusABC):
    """Gives the frames that a test has put there; discards what is sent."""

    def __init__(self) -> None:
        super().__init__(channel="wire")
        self.channel_info = "wire"
        self.waiting: deque[can.Message] = deque()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Discard it."""

    def recv(self, timeout: float | None = None) -> can.Message | None:
        return self.waiting.popleft() if self.waiting else None


def test_of_two_commands_in_one_period_the_newest_is_passed_on_once() -> None:
    car, wire = example(), Wire()
    bus = ForeignBus(wire, car, lambda: 20.0)
    writer, vehicle, inbox = command_writer(car), Outbox(bus, Node.VEHICLE), Inbox(Node.VEHICLE)
    passed = []
    for period in range(6):
        vehicle.send(STATE, SAMPLE, 0, counter=period)
        for number in (2 * period, 2 * period + 1):
            values = {"throttle": number / 20, "brake_n": 0.0, "steer_rad": 0.0}
            named = {f"commands.{name}": value for name, value in values.items()}
            named["commands.mode"] = float(Mode.NOMINAL)
            wire.waiting.extend(writer.frames(named, number, True))
        while (frame := bus.recv(0)) is not None:
            inbox.accept(frame, period)
        newest = inbox.newest(COMMAND)
        passed.append(None if newest is None else newest.content.control.throttle)
    bus.shutdown()
    assert inbox.counts.contradicting == 0
    assert inbox.counts.wrong_sequence == 0
    assert passed == pytest.approx([(2 * period + 1) / 20 for period in range(6)], abs=0.01)
