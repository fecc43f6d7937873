"""A bridge with faults, a scripted controller, and what arrives at both ends."""

from collections.abc import Sequence
from itertools import count
from typing import Any, NamedTuple

from can import Message
from scripted_controller import send_command

from rt_controller.bus.messages import COMMAND, HEARTBEAT, STATE, Command, Node
from rt_controller.bus.receive import Inbox
from rt_controller.bus.send import Outbox
from rt_controller.bus.transport import open_bus
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, Mode
from rt_controller.contract.timing import PERIOD_NS, PERIOD_S
from sim_bridge.bridge import Bridge, Delay
from sim_bridge.scenario import parse_scenario
from sim_bridge.session import build_car

START_TICK, FAULTY_TICKS = 10, 5
STANDBY_TICKS = 3
"""before the drive: afterwards the vehicle follows the commands"""
_channels = count()


class Frame(NamedTuple):
    """One frame, and the period in which it arrived."""

    tick: int
    arbitration_id: int
    data: bytes


class _Log:
    """Notes what the vehicle receives."""

    def __init__(self) -> None:
        self.frames: list[tuple[int, int, bytes]] = []

    def record(self, message: Message, now_ns: int, is_sent: bool = False) -> None:
        self.frames.append((now_ns, message.arbitration_id, bytes(message.data)))


class FaultyDrive:
    """Faults act from `START_TICK` on for `FAULTY_TICKS` unless they name other times."""

    def __init__(self, faults: Sequence[dict[str, Any]], speed_kmh: float = 50.0) -> None:
        times = {"start_s": START_TICK * PERIOD_S, "duration_s": FAULTY_TICKS * PERIOD_S}
        content = {
            "format": 2, "name": "faulty", "duration_s": 5.0,
            "reference": {"speed_kmh": speed_kmh},
            "road": {"curvature_per_m": 0.002},
            "faults": [times | fault for fault in faults],
        }  # fmt: skip
        scenario = parse_scenario(content, "test")
        channel = f"faulty-drive-{next(_channels)}"
        self.bus, self._controller_bus = (open_bus("virtual", channel) for _ in range(2))
        self._log = _Log()
        self.bridge = Bridge(
            self.bus,
            build_car(scenario),
            scenario,
            self._log,
            delay=Delay(0, 0),  # type: ignore[arg-type]
        )
        self.received = Inbox(Node.CONTROLLER)
        self._controller = Outbox(self._controller_bus, Node.CONTROLLER)
        self.now_ns = 0
        self._ticks = -STANDBY_TICKS
        self.to_controller: list[Frame] = []
        for _ in range(STANDBY_TICKS):
            self.tick()

    def close(self) -> None:
        """Shut down both ends."""
        self.bridge.close()
        self.bus.shutdown()
        self._controller_bus.shutdown()

    def tick(self) -> None:
        """The controller commands, then one period of the vehicle."""
        self.now_ns += PERIOD_NS
        self._ticks += 1
        state = self.received.newest(STATE)
        counter = 0 if state is None else state.counter
        wheel_rad = 0.001 * self._ticks
        command = Command(ControlInput(0.1, 0.0, wheel_rad), Mode.NOMINAL)
        if self._ticks <= 0:
            command = Command(NEUTRAL_INPUT, Mode.STANDBY)
        send_command(self._controller, command, self.now_ns, counter)
        self.bridge.tick(self.now_ns)
        while (message := self._controller_bus.recv(0)) is not None:
            frame = Frame(self._ticks, message.arbitration_id, bytes(message.data))
            self.to_controller.append(frame)
            self.received.accept(message, self.now_ns)

    def run(self, ticks: int) -> "FaultyDrive":
        """Tick several times."""
        for _ in range(ticks):
            self.tick()
        return self

    @property
    def to_vehicle(self) -> list[Frame]:
        """What the controller sent, as it arrived, and frames of a third participant."""
        codecs = {c.arbitration_id for c in COMMAND.codecs + HEARTBEAT.codecs}
        late = STANDBY_TICKS
        return [
            Frame(t // PERIOD_NS - late, i, data) for t, i, data in self._log.frames if i in codecs
        ]

    def ticks_with(self, message: Any, ticks: int) -> int:
        """Number of the next ticks that bring a new content of a message."""
        found = 0
        for _ in range(ticks):
            before = self.received.newest(message)
            self.tick()
            found += self.received.newest(message) is not before
        return found
