"""The vehicle's end of the bus with a scripted controller at the other, ticked in lockstep."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from typing import Any

import can
from scripted_controller import send_command

from rt_controller.bus.messages import STATE, Command, Message, Node, StateSample
from rt_controller.bus.receive import Inbox
from rt_controller.bus.send import Outbox
from rt_controller.bus.transport import open_bus
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, Mode
from rt_controller.contract.timing import PERIOD_NS
from sim_bridge.bridge import DEFAULT_DELAY, Bridge, Delay
from sim_bridge.scenario import load_scenario
from sim_bridge.session import build_car

CRUISE = ControlInput(0.12, 0.0, 0.0)
STANDBY_TICKS = 3
"""after so many commands the links are valid"""
_channels = count()


@dataclass(slots=True)
class BridgeRig:
    """A bridge and a scripted controller, ticked in lockstep."""

    bridge: Bridge
    controller: Outbox
    controller_bus: can.BusABC
    bus: can.BusABC
    received: Inbox
    now_ns: int = 0
    counter: int = 0
    """that the controller answers with"""

    def tick(self, control: ControlInput | None = CRUISE, mode: Mode = Mode.NOMINAL) -> StateSample:
        """The state after a period in which the controller sends a command, or none."""
        self.now_ns += PERIOD_NS
        if control is not None:
            command = Command(control, mode)
            send_command(self.controller, command, self.now_ns, self.counter)
        self.bridge.tick(self.now_ns)
        self.received.drain(self.controller_bus, self.now_ns)
        state = self.received.newest(STATE)
        assert state is not None
        self.counter = state.counter
        return state.content

    def newest(self, message: Message) -> Any:
        received = self.received.newest(message)
        assert received is not None
        return received.content


@contextmanager
def open_bridge(delay: Delay = DEFAULT_DELAY) -> Iterator[BridgeRig]:
    """A bridge of the scenario `straight` that uses the commands of its controller from now on."""
    channel = f"bridge-test-{next(_channels)}"
    scenario = load_scenario("straight")
    with open_bus("virtual", channel) as bus, open_bus("virtual", channel) as controller_bus:
        bridge = Bridge(bus, build_car(scenario), scenario, delay=delay)
        controller = Outbox(controller_bus, Node.CONTROLLER)
        rig = BridgeRig(bridge, controller, controller_bus, bus, Inbox(Node.CONTROLLER))
        for _ in range(STANDBY_TICKS):
            rig.tick(NEUTRAL_INPUT, Mode.STANDBY)
        yield rig
