"""The simulated car with another car's messages: a mapping file, reversed.

The bridge reads and writes this bus like any other. On the bus below it the car's own messages are
sent, with the periods of its DBC, and its commands are received.
"""

from collections.abc import Callable, Mapping
from math import nan
from typing import Any

import can
import numpy as np

from rt_controller.bus.identity import own_identity
from rt_controller.bus.messages import (
    COMMAND,
    CONTROLLER_IDENTITY,
    FEEDBACK,
    HEARTBEAT,
    MISSION,
    REFERENCE,
    STATE,
    Command,
    Heartbeat,
    Message,
    Node,
)
from rt_controller.bus.receive import Inbox, Received
from rt_controller.bus.send import Outbox
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.faults import NO_FAULT
from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.contract.timing import IDENT_PERIOD_TICKS
from rt_controller.mapping.car_file import CarFile
from rt_controller.mapping.signal_frames import FrameQueue, SignalReader, SignalWriter
from rt_controller.mapping.slots import Slot, command_slots, driving_slot, measured_slots
from sim_bridge.scenario import Scenario

CURVATURE_TOLERANCE_PER_M = 5e-4
"""between the scenario's road and the reference line of the mapping"""
_COMPARED = 200
_TABLES = ("states", "exogenous", "pose", "mission", "reference", "inputs")
_SENT_WITH: dict[str, Message[Any]] = {"reference": REFERENCE, "inputs": FEEDBACK}
"""messages with signals of other tables are sent with the state"""


class ForeignBus(can.BusABC):
    """Translates for the simulated car; closes the bus below it."""

    def __init__(self, inner: can.BusABC, car: CarFile, s_m: Callable[[], float]) -> None:
        """Find every signal in the DBC.

        Args:
            inner: the bus with the car's own messages.
            car: its mapping.
            s_m: arc length of the simulated car on the reference line.

        Raises:
            ConfigError, DatasetError: a signal is not in the DBC, or its unit does not fit.
        """
        mapping, where = car.mapping, str(car.path)
        self._inner = inner
        self._line = car.line
        self._s_m = s_m
        self._queue = FrameQueue()
        self._inbox = Inbox(Node.CONTROLLER)
        self._outbox = Outbox(self._queue, Node.CONTROLLER)
        slots = measured_slots(mapping)
        sources = SignalReader(slots, {}, car.database, where).sources
        # A message with signals of several tables is sent with the first of them.
        sent_with: dict[str, Message[Any]] = {}
        for slot in sorted(slots, key=lambda slot: _TABLES.index(_table(slot))):
            sent_with.setdefault(
                sources[slot.name].message.name, _SENT_WITH.get(_table(slot), STATE)
            )
        self._writers: dict[Message[Any], SignalWriter] = {}
        for message in (STATE, REFERENCE, FEEDBACK):
            own = [s for s in slots if sent_with[sources[s.name].message.name] is message]
            self._writers[message] = SignalWriter(own, mapping.messages, car.database, where)
        commanded = [*command_slots(mapping), *driving_slot(mapping)]
        self._reader = SignalReader(commanded, mapping.messages, car.database, where)
        self._values = dict.fromkeys((slot.name for slot in slots), nan)
        # The car sends them before it is driven, perhaps in one message with its states.
        self._values |= {slot.name: 0.0 for slot in slots if _table(slot) == "inputs"}
        self._values |= {f"mission.{name}": 0.0 for name in ("engage", "acknowledge", "car_brakes")}
        self._commands: dict[str, float] = {}
        self._newest: dict[Message[Any], object] = dict.fromkeys(self._writers)
        self._ticks = -1
        self._answered = -1
        """counter of the state that the last commands answered: two in one period would contradict
        each other"""
        self.channel_info = f"{inner.channel_info}, translated by {car.path.name}"
        super().__init__(channel=car.path.name)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send the content of a frame of the contract in the car's own messages."""
        self._inbox.accept(msg, 0)
        for message, writer in self._writers.items():
            newest: Received[object] | None = self._inbox.newest(message)
            if newest is not None and newest is not self._newest[message]:
                self._newest[message] = newest
                self._ticks += message is STATE
                self._keep()
                for frame in writer.frames(self._values, self._ticks):
                    self._inner.send(frame, timeout=timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame of the controller, made from the car's commands; never waits."""
        while (frame := self._inner.recv(0)) is not None:
            values = self._reader.read(frame)
            if values is not None:
                self._commands |= values
        self._forward()
        return self._queue.frames.popleft() if self._queue.frames else None

    def shutdown(self) -> None:
        """Close the bus below."""
        super().shutdown()
        self._inner.shutdown()

    def _keep(self) -> None:
        """Keep the newest contents of the contract as values of the slots."""
        values = self._values
        state, path = self._inbox.newest(STATE), self._inbox.newest(REFERENCE)
        applied, mission = self._inbox.newest(FEEDBACK), self._inbox.newest(MISSION)
        if state is not None:
            sample = state.content
            values |= _named("states", sample.state._asdict())
            values["exogenous.curvature_per_m"] = sample.curvature_per_m
            values["mission.car_brakes"] = float(sample.is_watchdog_braking)
            if self._line is not None:
                place = self._line.place(self._s_m(), sample.state.ey_m, sample.state.epsi_rad)
                values |= dict(zip(("pose.x", "pose.y", "pose.yaw"), place, strict=True))
        if path is not None:
            values |= _named("reference", path.content._asdict())
        if applied is not None:
            values |= _named("inputs", applied.content._asdict())
        if mission is not None:
            values["mission.engage"] = float(mission.content.is_engaged)
            values["mission.acknowledge"] = float(mission.content.is_reset_requested)

    def _forward(self) -> None:
        """Pass on the newest commands of a period, once all of them have arrived."""
        commands = self._commands
        names = [f"commands.{name}" for name in ControlInput._fields]
        state = self._inbox.newest(STATE)
        if state is None or state.counter == self._answered or not set(names) <= commands.keys():
            return
        self._answered = state.counter
        mode = Mode.NOMINAL if commands.get("driving", 1.0) > 0.5 else Mode.STANDBY
        if "commands.mode" in commands:
            number = round(commands.pop("commands.mode"))
            mode = Mode(number) if number in list(Mode) else Mode.STANDBY
        control = ControlInput(*(commands.pop(name) for name in names))
        send, counter = self._outbox.send, state.counter
        heartbeat = Heartbeat(mode, NO_FAULT, counter, None, None, None)
        send(COMMAND, Command(control, mode), 0, counter=counter)
        send(HEARTBEAT, heartbeat, 0, counter=counter)
        if self._ticks % IDENT_PERIOD_TICKS == 0:
            send(CONTROLLER_IDENTITY, own_identity(None), 0)


def require_same_road(car: CarFile, scenario: Scenario) -> None:
    """Return if the reference line of the mapping is the road of the scenario.

    Raises:
        ConfigError: their curvatures differ, or the line is shorter.
    """
    if car.line is None:
        return
    s_m = np.linspace(scenario.start.s_m, min(car.line.length_m, scenario.end_m), _COMPARED)
    of_line = car.line.curvature_ahead(s_m[0], s_m[-1] - s_m[0], _COMPARED)
    of_road = scenario.road.curvature_per_m(s_m)
    worst = int(np.argmax(np.abs(of_line - of_road)))
    if abs(of_line[worst] - of_road[worst]) > CURVATURE_TOLERANCE_PER_M:
        raise ConfigError(
            f"{car.path}: expected a reference_line with the curvature of the road of "
            f"{scenario.name!r}, found {of_line[worst]:.4g} 1/m instead of {of_road[worst]:.4g} "
            f"1/m at {s_m[worst]:.0f} m. Choose the scenario of that road, or write the points of "
            f"this road into the reference_line, the first at its start."
        )


def _table(slot: Slot) -> str:
    return slot.name.partition(".")[0]


def _named(table: str, values: Mapping[str, float]) -> dict[str, float]:
    return {f"{table}.{name}": value for name, value in values.items()}
