"""The car's end of the contract's bus, made from the car's own messages.

It does for a car with other messages what `sim_bridge.bridge` does for the simulated one: states,
path and mission out once a period, commands in. The controller receives the frames of the contract
and does not depend on the mapping.
"""

from math import isfinite
from operator import eq

import can

from rt_controller.bus.identity import is_heartbeat_of, own_identity
from rt_controller.bus.messages import (
    COMMAND,
    FEEDBACK,
    HEARTBEAT,
    MISSION,
    PREVIEW,
    REFERENCE,
    STATE,
    VEHICLE_IDENTITY,
    Command,
    Mission,
    Node,
    StateSample,
)
from rt_controller.bus.receive import Inbox, Received
from rt_controller.bus.send import Outbox, SendingBus
from rt_controller.contract.faults import NO_REFUSAL
from rt_controller.contract.signals import ControlInput, Mode, PathReference, VehicleState
from rt_controller.contract.timing import (
    IDENT_PERIOD_TICKS,
    MISSION_PERIOD_TICKS,
    MISSION_VALID_NS,
    PERIOD_NS,
    counter_lag,
)
from rt_controller.gateway.road_place import (
    PlaceMeasured,
    PlaceOnLine,
    RoadPlace,
    preview_on,
    stop_at_end,
)
from rt_controller.gateway.samples import Motion, MotionHistory, Sample, Samples, SpeedSlope
from rt_controller.mapping.car_file import CarFile
from rt_controller.mapping.lateral_speed import LateralSpeed
from rt_controller.mapping.signal_frames import SignalReader, SignalWriter
from rt_controller.mapping.slots import command_slots, measured_slots
from rt_controller.vehicle.path_steering import Course

MISSION_ID = 1


class CarEnd:
    """Frames of the car in, frames of the contract out, and the reverse for commands."""

    def __init__(self, car: CarFile, lateral_speed: LateralSpeed, bus: SendingBus) -> None:
        """Find every signal in the DBC; `bus` receives the frames of the contract.

        Raises:
            ConfigError: a column is not in the DBC.
            DatasetError: a unit is missing or does not fit.
        """
        mapping, where = car.mapping, str(car.path)
        slots = measured_slots(mapping)
        self.reader = SignalReader(slots, mapping.messages, car.database, where)
        self.samples = Samples(slots, self.reader.sources)
        self._writer = SignalWriter(command_slots(mapping), mapping.messages, car.database, where)
        self._mapping = mapping
        self._slope = SpeedSlope()
        self._line = car.line
        self._place: PlaceOnLine | PlaceMeasured = PlaceMeasured()
        if car.line is not None and mapping.pose is not None and "ey_m" not in mapping.states:
            self._place = PlaceOnLine(
                car.line, mapping.pose.farthest_m, mapping.pose.ahead_m, mapping.pose.left_m
            )
        self._lateral_speed = lateral_speed
        self._inbox = Inbox(Node.VEHICLE)
        self._outbox = Outbox(bus, Node.VEHICLE)
        self._foreign_commands = 0
        self._history = MotionHistory()
        self._ticks = 0
        self._commands = 0
        self._taken: Received[Command] | None = None
        self._feedback_ns: tuple[int, ...] = ()
        self._mission: Mission | None = None
        self.course: Course | None = None
        """None: a signal is missing or not valid"""
        self.command: Received[Command] | None = None
        """the newest command, under the counter of the state that it answers"""
        self.is_braking = False
        """True if the gateway brakes the car by itself"""
        self.refusals = NO_REFUSAL
        """of the newest command; sent with the next state"""

    def accept(self, frame: can.Message, arrival_ns: int) -> None:
        """Keep the values of a frame of the car."""
        self._foreign_commands += frame.is_rx and self._writer.has(frame)
        values = self.reader.read(frame)
        if values is not None:
            self.samples.add(values, arrival_ns)

    def accept_command(self, frame: can.Message, arrival_ns: int) -> bool:
        """True if a frame of the controller completed a new command: ACT_CMD and its heartbeat."""
        self._inbox.accept(frame, arrival_ns)
        command = self._inbox.newest_valid(COMMAND, arrival_ns)
        heartbeat = self._inbox.newest_valid(HEARTBEAT, arrival_ns)
        if command is None or heartbeat is None or command is self._taken:
            return False
        if not is_heartbeat_of(heartbeat, command):
            return False
        self._taken = command
        if command.content.mode is not Mode.STANDBY and self._has_driver(arrival_ns):
            return False
        self.command = command._replace(counter=heartbeat.content.state_counter)
        return True

    def _has_driver(self, now_ns: int) -> bool:
        """True if the car was released and `engage` is off: a driver has taken over."""
        is_released = self.command is not None and self.command.content.mode is Mode.STANDBY
        return is_released and self.samples.is_on("mission.engage", now_ns) is False

    @property
    def foreign_frames(self) -> int:
        """Frames of this gateway's messages that another node has sent, on either bus."""
        return self._foreign_commands + self._inbox.foreign_frames

    @property
    def message_of_two(self) -> str:
        """What is wrong with a message of the car that two nodes send; empty: there is none."""
        for name, source in self.reader.sources.items():
            if len(self.reader.counts[source.message.name].sources) > 1:
                return ". ".join(self.reader.objection(name))
        return ""

    def follows(self, now_ns: int) -> bool | None:
        """Whether the car reports that it follows the commands; None: not known.

        A car without such a signal follows.
        """
        if not self.samples.has("mission.car_brakes"):
            return True
        brakes = self.samples.is_on("mission.car_brakes", now_ns)
        return None if brakes is None else not brakes

    def age_ns(self, now_ns: int) -> int | None:
        """Age of the newest command: since its arrival, or that of the state that it answers."""
        if self.command is None:
            return None
        lag = counter_lag(newer=self._ticks - 1, older=self.command.counter)
        return max(now_ns - self.command.arrival_ns, lag * PERIOD_NS)

    def command_frames(self, control: ControlInput, mode: Mode) -> list[can.Message]:
        """The frames for the car that are due with this command."""
        self._commands += 1
        return self._frames(control, mode, self._commands - 1)

    def last_frames(self, control: ControlInput, mode: Mode) -> list[can.Message]:
        """Every frame for the car, due or not: a released car gets released pedals."""
        if mode is Mode.STANDBY:
            control = control._replace(throttle=0.0, brake_n=0.0)
        return self._frames(control, mode, 0)

    def _frames(self, control: ControlInput, mode: Mode, tick: int) -> list[can.Message]:
        values = {f"commands.{name}": value for name, value in control._asdict().items()}
        values["commands.mode"] = float(mode)
        return self._writer.frames(values, tick, mode is not Mode.STANDBY)

    def send(self, now_ns: int, skipped_ticks: int = 0) -> None:
        """Send what the controller receives in one period, as far as the car's signals allow."""
        self._ticks += skipped_ticks
        self._inbox.end_period(now_ns)
        send, tick = self._outbox.send, self._ticks
        motion = self._motion(now_ns)
        place = None if motion is None else self._place.locate(self.samples, self._history, motion)
        self.course = None
        if motion is not None and place is not None:
            sample = self._state(motion, place, now_ns)
            send(STATE, sample, now_ns, counter=tick)
            path = self._path(place, motion.vx_mps, now_ns)
            if path is not None:
                if all(map(isfinite, (*sample.state, *path))):
                    self.course = Course(path, sample.state, place.curvature_per_m)
                send(REFERENCE, path, now_ns, counter=tick)
                preview = preview_on(self._line, place.s_m, motion.vx_mps, path.v_mps)
                send(PREVIEW, preview, now_ns, counter=tick)
        feedback = self._applied(now_ns)
        if feedback is not None:
            send(FEEDBACK, feedback, now_ns)
        mission = self._requested_mission(now_ns)
        is_new = mission != self._mission
        if mission is not None and (is_new or tick % MISSION_PERIOD_TICKS == 0):
            send(MISSION, mission, now_ns)
        self._mission = mission
        if tick % IDENT_PERIOD_TICKS == 0:
            send(VEHICLE_IDENTITY, own_identity(None), now_ns)
        self.refusals = NO_REFUSAL
        self._ticks += 1

    def _motion(self, now_ns: int) -> Motion | None:
        """The present velocities; None: a signal is missing."""
        vx = self.samples.newest("states.vx_mps", now_ns)
        yaw_rate = self.samples.newest("states.yaw_rate_radps", now_ns)
        if vx is None or yaw_rate is None:
            self._lateral_speed.forget()
            return None
        vy_mps = self._lateral_speed.update(vx.value, yaw_rate.value)
        if self.samples.has("states.vy_mps"):
            vy = self.samples.newest("states.vy_mps", now_ns)
            if vy is None:
                return None
            vy_mps = vy.value
        motion = Motion(now_ns, vx.value, vy_mps, yaw_rate.value)
        if all(map(isfinite, motion)):
            self._history.add(motion)
        return motion

    def _applied(self, now_ns: int) -> ControlInput | None:
        """The inputs that the car reports as applied; None: not mapped, missing, or not all new.

        The controller compares them with its commands, so old ones must not be sent again.
        """
        known = self._reported(now_ns)
        times = tuple(each.measured_ns for each in known)
        if not known or any(map(eq, times, self._feedback_ns)):
            return None
        self._feedback_ns = times
        return ControlInput(*(each.value for each in known))

    def reported(self, now_ns: int) -> ControlInput | None:
        """The same, also if some are not new."""
        known = self._reported(now_ns)
        return ControlInput(*(each.value for each in known)) if known else None

    def _reported(self, now_ns: int) -> list[Sample]:
        samples = [self.samples.newest(f"inputs.{name}", now_ns) for name in ControlInput._fields]
        known = [each for each in samples if each is not None and isfinite(each.value)]
        return known if len(known) == len(samples) else []

    def _state(self, motion: Motion, place: RoadPlace, now_ns: int) -> StateSample:
        _, vx_mps, vy_mps, yaw_rate = motion
        return StateSample(
            state=VehicleState(vx_mps, vy_mps, yaw_rate, place.ds_m, place.ey_m, place.epsi_rad),
            curvature_per_m=place.curvature_per_m,
            sample_time_ns=now_ns,
            command_echo=None if self.command is None else self.command.counter,
            is_watchdog_braking=self.is_braking or self.follows(now_ns) is not True,
            refusals=self.refusals,
        )

    def _path(self, place: RoadPlace, vx_mps: float, now_ns: int) -> PathReference | None:
        """The path and speed from here on; None: a signal is missing."""
        values = []
        for name in PathReference._fields:
            value = getattr(self._mapping.reference, name)
            if not isinstance(value, float | int):
                sample = self.samples.newest(f"reference.{name}", now_ns)
                if sample is None:
                    return None
                value = sample.value
            values.append(float(value))
        path = PathReference(*values)
        if isinstance(self._mapping.reference.a_mps2, float | int) and not values[-1]:
            path = path._replace(a_mps2=self._slope.mps2(path.v_mps, now_ns))
        if self._line is None:
            return path
        return stop_at_end(self._line, path, place.s_m, vx_mps, self._mapping.reference.stop_mps2)

    def _requested_mission(self, now_ns: int) -> Mission | None:
        """Whether the car requests to be driven; None: its signal is missing."""
        engage = self._mapping.mission.engage
        is_engaged = True if engage is True else self.samples.is_on("mission.engage", now_ns)
        if is_engaged is None:
            return None
        is_acknowledged = self.samples.is_on("mission.acknowledge", now_ns) is True
        return Mission(is_engaged, is_acknowledged, MISSION_ID, MISSION_VALID_NS)
