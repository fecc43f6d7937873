"""The vehicle's end of the bus with a scripted controller at the other, ticked in lockstep."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import count
from typing import Any, NamedTuple

from made_frames import RecordedFrames

from rt_controller.bus.messages import (
    COMMAND,
    HEARTBEAT,
    STATE,
    Command,
    Heartbeat,
    Message,
    Node,
    StateSample,
)
from rt_controller.bus.receive import Inbox
from rt_controller.bus.send import Outbox
from rt_controller.bus.transport import open_bus
from rt_controller.contract.faults import Fault
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, Mode
from rt_controller.contract.timing import PERIOD_NS, PERIOD_S
from rt_controller.settings import CarSettings
from sim_bridge.bridge import DEFAULT_DELAY, Bridge, Delay
from sim_bridge.scenario import Scenario, load_scenario, parse_scenario
from sim_bridge.session import build_car

CRUISE = ControlInput(0.12, 0.0, 0.0)
STANDBY_TICKS = 3
"""after so many commands the links are valid"""
START_TICK, FAULTY_TICKS = 10, 5
"""of the faults of a `FaultyDrive` that name no times"""
_channels = count()


def send_command(outbox: Outbox, command: Command, now_ns: int, counter: int) -> None:
    """A command with its heartbeat, which answers the state with this long counter."""
    heartbeat = Heartbeat(command.mode, Fault(0), counter % 128, 500_000, 1_000_000, 3)
    outbox.send(COMMAND, command, now_ns, counter=counter)
    outbox.send(HEARTBEAT, heartbeat, now_ns, counter=counter)


class Frame(NamedTuple):
    """One frame, and the period in which it arrived."""

    tick: int
    arbitration_id: int
    data: bytes


class BridgeRig:
    """A bridge and a scripted controller; `ticks` counts from the first that is no standby."""

    def __init__(
        self, scenario: Scenario, delay: Delay, settings: CarSettings | None = None
    ) -> None:
        channel = f"bridge-rig-{next(_channels)}"
        self.bus, self.controller_bus = (open_bus("virtual", channel) for _ in range(2))
        car = build_car(scenario, settings or CarSettings())
        self.arrived = RecordedFrames()
        """at the vehicle, and sent by it"""
        self.bridge = Bridge(self.bus, car, scenario, self.arrived, delay=delay)
        self.controller = Outbox(self.controller_bus, Node.CONTROLLER)
        self.received = Inbox(Node.CONTROLLER)
        self.to_controller: list[Frame] = []
        self.counter = self.now_ns = 0
        self.ticks = -STANDBY_TICKS
        for _ in range(STANDBY_TICKS):
            self.tick(NEUTRAL_INPUT, Mode.STANDBY)

    def tick(self, control: ControlInput | None = CRUISE, mode: Mode = Mode.NOMINAL) -> StateSample:
        """The state after a period in which the controller sends a command, or none."""
        self.now_ns += PERIOD_NS
        self.ticks += 1
        if control is not None:
            send_command(self.controller, Command(control, mode), self.now_ns, self.counter)
        self.bridge.tick(self.now_ns)
        while (message := self.controller_bus.recv(0)) is not None:
            data = bytes(message.data)
            self.to_controller.append(Frame(self.ticks, message.arbitration_id, data))
            self.received.accept(message, self.now_ns)
        state = self.received.newest(STATE)
        assert state is not None
        self.counter = state.counter
        return state.content

    def newest(self, message: Message) -> Any:
        """The newest content that the controller received."""
        received = self.received.newest(message)
        assert received is not None
        return received.content

    def close(self) -> None:
        """Shut down both ends."""
        self.bridge.close()
        for bus in (self.bus, self.controller_bus):
            bus.shutdown()


@contextmanager
def open_bridge(delay: Delay = DEFAULT_DELAY) -> Iterator[BridgeRig]:
    """A bridge of the scenario `straight` that uses the commands of its controller from now on."""
    rig = BridgeRig(load_scenario("straight"), delay)
    try:
        yield rig
    finally:
        rig.close()


class FaultyDrive(BridgeRig):
    """A drive with faults, whose controller turns the wheel a little farther in every period."""

    def __init__(self, faults: Sequence[dict[str, Any]]) -> None:
        times = {"start_s": START_TICK * PERIOD_S, "duration_s": FAULTY_TICKS * PERIOD_S}
        content = {
            "format": 2, "name": "faulty", "duration_s": 5.0, "reference": {"speed_kmh": 50.0},
            "road": {"curvature_per_m": 0.002}, "faults": [times | fault for fault in faults],
        }  # fmt: skip
        super().__init__(parse_scenario(content, "test"), Delay(0, 0))

    def run(self, ticks: int) -> "FaultyDrive":
        """Tick several times."""
        for _ in range(ticks):
            self.tick(ControlInput(0.1, 0.0, 0.001 * (self.ticks + 1)))
        return self

    @property
    def to_vehicle(self) -> list[Frame]:
        """What the controller sent, as it arrived, and frames of a third participant."""
        codecs = {codec.arbitration_id for codec in COMMAND.codecs + HEARTBEAT.codecs}
        return [
            Frame(time_ns // PERIOD_NS - STANDBY_TICKS, number, data)
            for time_ns, number, data in self.arrived.frames
            if number in codecs
        ]

    def ticks_with(self, message: Any, ticks: int) -> int:
        """Number of the next ticks that bring a new content of a message."""
        found = 0
        for _ in range(ticks):
            before = self.received.newest(message)
            self.run(1)
            found += self.received.newest(message) is not before
        return found
