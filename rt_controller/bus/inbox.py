"""The two letter boxes: what the controller receives, and what the vehicle receives.

Each keeps the newest snapshot of every kind for ever. Whether that is fresh enough is for the
reader to judge: a box knows no clock.
"""

from typing import Generic, NamedTuple, TypeVar

import can

from rt_controller.bus import frames
from rt_controller.bus.codec import Frame
from rt_controller.bus.frames import PathPart, RoadSample, SpeedPart
from rt_controller.bus.reception import MAX_FRAMES_PER_DRAIN, Reception, ReceptionCounts
from rt_controller.bus.recorder import FrameSink
from rt_controller.bus.snapshot import (
    CommandSnapshot,
    FeedbackSnapshot,
    HeartbeatSnapshot,
    MissionSnapshot,
    PeerIdentity,
    ReferenceSnapshot,
    StateSnapshot,
)
from rt_controller.contract.signals import PathReference, VehicleState
from rt_controller.contract.timing import COUNTER_MODULUS, PERIOD_NS

MAX_SPREAD_NS = COUNTER_MODULUS // 2 * PERIOD_NS
"""Frames of one counter that arrived farther apart may be of different rounds of the counter."""

T = TypeVar("T")


class _Part(NamedTuple, Generic[T]):
    """One frame of a snapshot that needs several."""

    content: T
    counter: int
    arrival_ns: int


class Inbox:
    """The controller's side: the newest valid state, reference, mission, feedback and peer."""

    def __init__(self, recorder: FrameSink | None = None) -> None:
        self.state: StateSnapshot | None = None
        self.reference: ReferenceSnapshot | None = None
        self.mission: MissionSnapshot | None = None
        self.feedback: FeedbackSnapshot | None = None
        self.peer: PeerIdentity | None = None
        self.foreign_commands = 0
        """ACT_CMD frames heard: a bus does not give back what one sent, so another controller's"""
        self._state_a: _Part[tuple[float, ...]] | None = None
        self._state_b: _Part[tuple[float, ...]] | None = None
        self._state_c: _Part[RoadSample] | None = None
        self._path: _Part[PathPart] | None = None
        self._speed: _Part[SpeedPart] | None = None
        self._reception = Reception(
            {
                frames.STATE_A: self._take_state_a,
                frames.STATE_B: self._take_state_b,
                frames.STATE_C: self._take_state_c,
                frames.ACT_FB: self._take_feedback,
                frames.REF_PATH: self._take_path,
                frames.REF_SPEED: self._take_speed,
                frames.MISSION: self._take_mission,
                frames.IDENT_VEHICLE: self._take_identity,
                frames.ACT_CMD: self._take_foreign_command,
            },
            recorder,
        )

    @property
    def counts(self) -> ReceptionCounts:
        return self._reception.counts

    @property
    def last_failure(self) -> str:
        """Why the bus could not be read, for people; empty as long as it could."""
        return self._reception.last_failure

    def drain(self, bus: can.BusABC, now_ns: int, most: int = MAX_FRAMES_PER_DRAIN) -> int:
        """How many frames were read from the bus; they are in the box now, stamped `now_ns`."""
        return self._reception.drain(bus, now_ns, most)

    def accept(self, message: can.Message, arrival_ns: int) -> None:
        """Put one frame into the box."""
        self._reception.accept(message, arrival_ns)

    def _take_state_a(self, frame: Frame, counter: int, arrival_ns: int) -> bool:
        content = frames.decode_state_a(frame)
        self._state_a = None if content is None else _Part(content, counter, arrival_ns)
        self._join_state()
        return content is not None

    def _take_state_b(self, frame: Frame, counter: int, arrival_ns: int) -> bool:
        content = frames.decode_state_b(frame)
        self._state_b = None if content is None else _Part(content, counter, arrival_ns)
        self._join_state()
        return content is not None

    def _take_state_c(self, frame: Frame, counter: int, arrival_ns: int) -> bool:
        content = frames.decode_state_c(frame)
        self._state_c = None if content is None else _Part(content, counter, arrival_ns)
        self._join_state()
        return content is not None

    def _join_state(self) -> None:
        a, b, c = self._state_a, self._state_b, self._state_c
        if a is None or b is None or c is None:
            return
        if not a.counter == b.counter == c.counter:
            return
        oldest_ns = min(a.arrival_ns, b.arrival_ns, c.arrival_ns)
        if max(a.arrival_ns, b.arrival_ns, c.arrival_ns) - oldest_ns > MAX_SPREAD_NS:
            return
        road = c.content
        self.state = StateSnapshot(
            state=VehicleState(*a.content, *b.content),
            curvature_per_m=road.curvature_per_m,
            sample_time_ns=road.sample_time_ns,
            command_echo=road.command_echo,
            is_watchdog_braking=road.is_watchdog_braking,
            counter=c.counter,
            arrival_ns=oldest_ns,
        )

    def _take_path(self, frame: Frame, counter: int, arrival_ns: int) -> bool:
        content = frames.decode_reference_path(frame)
        self._path = None if content is None else _Part(content, counter, arrival_ns)
        self._join_reference()
        return content is not None

    def _take_speed(self, frame: Frame, counter: int, arrival_ns: int) -> bool:
        content = frames.decode_reference_speed(frame)
        self._speed = None if content is None else _Part(content, counter, arrival_ns)
        self._join_reference()
        return content is not None

    def _join_reference(self) -> None:
        path, speed = self._path, self._speed
        if path is None or speed is None or path.counter != speed.counter:
            return
        if abs(path.arrival_ns - speed.arrival_ns) > MAX_SPREAD_NS:
            return
        self.reference = ReferenceSnapshot(
            path=PathReference(*path.content, *speed.content),
            counter=path.counter,
            arrival_ns=min(path.arrival_ns, speed.arrival_ns),
        )

    def _take_feedback(self, frame: Frame, counter: int, arrival_ns: int) -> bool:
        applied = frames.decode_feedback(frame)
        if applied is None:
            return False
        self.feedback = FeedbackSnapshot(applied, counter, arrival_ns)
        return True

    def _take_mission(self, frame: Frame, counter: int, arrival_ns: int) -> bool:
        mission = frames.decode_mission(frame)
        if mission is None:
            return False
        self.mission = MissionSnapshot(*mission, counter=counter, arrival_ns=arrival_ns)
        return True

    def _take_identity(self, frame: Frame, counter: int, arrival_ns: int) -> bool:
        identity = frames.decode_vehicle_identity(frame)
        if identity is None:
            return False
        self.peer = PeerIdentity(*identity, counter=counter, arrival_ns=arrival_ns)
        return True

    def _take_foreign_command(self, frame: Frame, counter: int, arrival_ns: int) -> bool:
        self.foreign_commands += 1
        return True


class CommandInbox:
    """The vehicle's side: the newest valid command, heartbeat and peer."""

    def __init__(self, recorder: FrameSink | None = None) -> None:
        self.command: CommandSnapshot | None = None
        self.heartbeat: HeartbeatSnapshot | None = None
        self.peer: PeerIdentity | None = None
        self._reception = Reception(
            {
                frames.ACT_CMD: self._take_command,
                frames.CTRL_HB: self._take_heartbeat,
                frames.IDENT_CONTROLLER: self._take_identity,
            },
            recorder,
        )

    @property
    def counts(self) -> ReceptionCounts:
        return self._reception.counts

    @property
    def last_failure(self) -> str:
        """Why the bus could not be read, for people; empty as long as it could."""
        return self._reception.last_failure

    def drain(self, bus: can.BusABC, now_ns: int) -> int:
        """How many frames were waiting on the bus; they are in the box now, stamped `now_ns`."""
        return self._reception.drain(bus, now_ns)

    def accept(self, message: can.Message, arrival_ns: int) -> None:
        """Put one frame into the box."""
        self._reception.accept(message, arrival_ns)

    def _take_command(self, frame: Frame, counter: int, arrival_ns: int) -> bool:
        command = frames.decode_command(frame)
        if command is None:
            return False
        self.command = CommandSnapshot(command.control, command.mode, counter, arrival_ns)
        return True

    def _take_heartbeat(self, frame: Frame, counter: int, arrival_ns: int) -> bool:
        heartbeat = frames.decode_heartbeat(frame)
        if heartbeat is None:
            return False
        self.heartbeat = HeartbeatSnapshot(*heartbeat, counter=counter, arrival_ns=arrival_ns)
        return True

    def _take_identity(self, frame: Frame, counter: int, arrival_ns: int) -> bool:
        identity = frames.decode_controller_identity(frame)
        if identity is None:
            return False
        self.peer = PeerIdentity(*identity, counter=counter, arrival_ns=arrival_ns)
        return True
