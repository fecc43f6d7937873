"""The vehicle's end of a bus with faults on the line."""

from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from copy import copy

import can

from rt_controller.bus.log.recorder import Recorder
from rt_controller.bus.message import Node
from rt_controller.contract.signals import ControlInput
from sim_bridge.faults.frame_change import FrameChange, distortions_of
from sim_bridge.faults.frame_faults import FramePath
from sim_bridge.faults.third_participant import ThirdParticipant
from sim_bridge.scenario.fault_targets import ACTUATOR
from sim_bridge.scenario.faults import Fault


class FaultyBus:
    """A layer between the vehicle and its bus, in both directions; `send` and `recv` as a bus.

    A fault between sender and receiver acts on the receiver only. Frames of a third participant
    reach both ends, as on a real bus, in each period after the genuine ones. A full or broken bus
    loses the frames that this class adds.
    """

    def __init__(
        self, bus: can.BusABC, faults: Sequence[Fault] = (), recorder: Recorder | None = None
    ) -> None:
        """Join a bus; `recorder` logs the frames of the vehicle as they arrive."""
        self._bus = bus
        self._recorder = recorder
        self._has_faults = bool(faults)
        self._tick = 0
        self._now_ns = 0
        self._change = FrameChange(faults)
        self._outgoing, self._incoming = FramePath(faults, 0), FramePath(faults, 1)
        self._third = ThirdParticipant(faults)
        self._arrived: deque[can.Message] = deque()
        self._foreign: deque[can.Message] = deque()
        self._has_read_all = True

    def begin_reading(self, tick: int) -> None:
        """Before the vehicle reads in a tick of the drive."""
        self._tick = tick
        self._arrived.extend(self._incoming.released(tick))
        self._has_read_all = False

    def begin_sending(self, tick: int, now_ns: int) -> None:
        """Before the vehicle sends its frames of a tick of the drive, at `now_ns`."""
        self._tick, self._now_ns = tick, now_ns
        for frame in self._outgoing.released(tick):
            with suppress(Exception):  # each backend raises its own type
                self._send(frame, 0)

    def end_sending(self) -> None:
        """After the vehicle has sent its frames."""
        self._add_foreign(Node.VEHICLE)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame of the vehicle, as the faults change it."""
        if not self._has_faults:
            self._send(msg, timeout)
            return
        self._third.observe(msg)
        frame = copy(msg)
        frame.data = bytearray(self._change.apply(msg.arbitration_id, msg.data, self._tick))
        for arrived in self._outgoing.passed(frame, self._tick):
            self._send(arrived, timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame for the vehicle; None: none is waiting."""
        if not self._has_faults:
            return self._bus.recv(timeout)
        while not self._arrived:
            frame = self._bus.recv(timeout)
            if frame is None:
                if not self._has_read_all:
                    self._has_read_all = True
                    self._add_foreign(Node.CONTROLLER)
                return self._foreign.popleft() if self._foreign else None
            self._third.observe(frame)
            data = self._change.apply(frame.arbitration_id, frame.data, self._tick)
            if data != frame.data:
                frame = copy(frame)
                frame.data = bytearray(data)
            self._arrived.extend(self._incoming.passed(frame, self._tick))
        return self._arrived.popleft()

    def _add_foreign(self, sender: Node) -> None:
        foreign = self._third.frames(self._tick, sender)
        self._foreign.extend(foreign)
        for frame in foreign:
            with suppress(Exception):
                self._bus.send(frame, 0)

    def _send(self, frame: can.Message, timeout: float | None) -> None:
        self._bus.send(frame, timeout)
        if self._recorder is not None:
            self._recorder.record(frame, self._now_ns)


class FaultyActuators:
    """What pedals and steering wheel do in place of the command."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        self._distortions = distortions_of(faults, ACTUATOR)

    def apply(self, commanded: ControlInput, tick: int) -> ControlInput:
        """The input of the plant in a tick of the drive; pedals stay within their travel."""
        if not self._distortions:
            return commanded
        values = list(commanded)
        for each in self._distortions:
            each.apply(values, commanded, tick)
        throttle, brake_n, steer_rad = values
        return ControlInput(min(max(throttle, 0.0), 1.0), max(brake_n, 0.0), steer_rad)


def acted(faults: Sequence[Fault], tick: int) -> tuple[str, ...]:
    """Kind, frames or signals, and time of each fault that has acted by this tick of the drive."""
    return tuple(
        fault.text for fault in faults if fault.ticks.start <= tick or fault.acts_before_drive
    )
