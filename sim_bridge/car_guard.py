"""The vehicle guards itself: which commands it follows, when it brakes, which actuators failed."""

from collections import Counter
from enum import Enum

from rt_controller.bus.identity import PeerCatalogue, is_heartbeat_of
from rt_controller.bus.messages import COMMAND, CONTROLLER_IDENTITY, HEARTBEAT, Command
from rt_controller.bus.receive import Inbox, Received
from rt_controller.contract.braking import (
    BRAKE_RATE_N_PER_S,
    FULL_BRAKE_N,
    FULL_BRAKE_RATE_N_PER_S,
    MOST_BRAKE_N,
)
from rt_controller.contract.faults import NO_REFUSAL, Refusal
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, Mode
from rt_controller.contract.timing import (
    COMMAND_TIMEOUT_NS,
    COMMAND_TIMEOUT_TICKS,
    PERIOD_NS,
    PERIOD_S,
    counter_lag,
)
from rt_controller.vehicle.braking_cause import BrakingCause
from rt_controller.vehicle.vehicle_envelope import (
    FARTHEST_OFF_PATH_M,
    OwnMotion,
    leaves_path,
    refusals,
)

FOREIGN_TICKS = COMMAND_TIMEOUT_TICKS
"""ticks in a row with frames of another vehicle after which commands are refused: the controller
cannot distinguish the states of the two"""
ORDERLY_MPS = 1.0
"""a drive that ends on purpose ends below this speed: the controller stops sending when it has
received a speed below 0.3 m/s"""
ORDERLY_TICKS = 2 * COMMAND_TIMEOUT_TICKS
"""a drive that ends on purpose ends after a safe stop of at least this length. A controller that
crashes sends one such command, which is in use for half as long"""
LARGEST_STEER_ERROR_RAD = 0.03
"""of a wheel that does not move: 1.7 deg"""
STILL_RAD = 1e-3
"""a wheel that moves by less in a period does not move"""
LEAST_CHANGE_RAD = 0.02
"""change of the command since the wheel last moved: with a constant command a wheel with an offset
does not move either"""
LARGEST_THROTTLE_ERROR = 0.05
"""by which the throttle may be open too far"""
FAILED_TICKS = COMMAND_TIMEOUT_TICKS
"""in a row, before the vehicle brakes by itself"""


class CommandCheck:
    """Takes the newest command in each tick, if it may be followed; it never raises."""

    def __init__(self, has_envelope: bool = True) -> None:
        """`has_envelope`: commands outside of the envelope are refused."""
        self._has_envelope = has_envelope
        self.accepted: Received[Command] | None = None
        """the newest command that may be followed; its counter is that of the state it answers"""
        self.refusals = NO_REFUSAL
        """of this tick; none if a command was accepted, or no new one arrived"""
        self.refused_ticks = Counter[str]()
        """by name of the refusal"""
        self._newest: Received[Command] | None = None
        self._periods = 0
        """since the last accepted command"""
        self._catalogue = PeerCatalogue()
        self._foreign_frames = self._foreign_ticks = 0

    def take(self, inbox: Inbox, now_ns: int, state_counter: int, motion: OwnMotion) -> None:
        """Check the frames that were received for this tick.

        Args:
            inbox: of the vehicle, after reading.
            now_ns: of this tick.
            state_counter: of the newest state that was sent.
            motion: of the car, by its own measurement.
        """
        self._periods += 1
        is_foreign = inbox.foreign_frames > self._foreign_frames
        self._foreign_frames = inbox.foreign_frames
        self._foreign_ticks = self._foreign_ticks + 1 if is_foreign else 0
        newest = inbox.newest(COMMAND)
        is_new = newest is not self._newest
        self._newest = newest
        self.refusals = NO_REFUSAL
        if (
            self._foreign_ticks >= FOREIGN_TICKS
            or self._catalogue.is_another(inbox.newest(CONTROLLER_IDENTITY))
            or inbox.has_conflict(COMMAND, now_ns)
            or inbox.has_conflict(HEARTBEAT, now_ns)
        ):  # controllers contradict each other, or another vehicle goes on sending
            self.refusals = Refusal.SOURCE
        elif is_new and newest is not None and inbox.newest_valid(COMMAND, now_ns) is not None:
            self.refusals = self._judge(newest, inbox, now_ns, state_counter, motion)
        for refusal in self.refusals:
            self.refused_ticks[refusal.name or ""] += 1

    def _judge(
        self,
        command: Received[Command],
        inbox: Inbox,
        now_ns: int,
        state_counter: int,
        motion: OwnMotion,
    ) -> Refusal:
        """Accept a new command, or return why it is refused."""
        heartbeat = inbox.newest_valid(HEARTBEAT, now_ns)
        if heartbeat is None or not is_heartbeat_of(heartbeat, command):
            return Refusal.HEARTBEAT
        answered = heartbeat.content.state_counter
        if counter_lag(newer=state_counter, older=answered) >= COMMAND_TIMEOUT_TICKS:
            return Refusal.LATE
        before, periods = NEUTRAL_INPUT, self._periods
        if self.accepted is not None:
            before = self.accepted.content.control
            # If the vehicle skipped ticks, the controller may have sent several commands.
            periods = max(periods, counter_lag(newer=answered, older=self.accepted.counter))
        if self._has_envelope and (found := refusals(command.content, before, periods, motion)):
            return found
        self.accepted, self._periods = command._replace(counter=answered), 0
        return NO_REFUSAL


class ActuatorWatchdog:
    """Brakes the car if no command may be followed, whatever the reason why they stopped.

    Once it brakes, it brakes until the program is restarted, also if commands arrive again.
    """

    def __init__(self) -> None:
        self.applied = NEUTRAL_INPUT
        self.braking_cause: BrakingCause | None = None
        """why it began to brake; None: it does not brake"""
        self.has_controller_ended = False
        """True if the commands stopped after a safe stop, at `ORDERLY_MPS` at most: the controller
        ended its drive, and did not fail while it drove"""
        self._safe_stop_ticks = 0
        self._has_reached_path = False

    def judge(
        self,
        command: Received[Command] | None,
        now_ns: int,
        state_counter: int,
        motion: OwnMotion,
        have_actuators_failed: bool,
    ) -> bool:
        """True if the vehicle brakes in the coming period; else the input is that of the command.

        The age of a command is the larger one of the time since its arrival and the age of the
        state that it answers, so a command that was delayed on the bus counts as old.

        Args:
            command: the newest one that may be followed; None: none has arrived.
            now_ns: time of this tick.
            state_counter: of the newest state that was sent.
            motion: of the car, by its own measurement.
            have_actuators_failed: the vehicle brakes by itself.
        """
        if self.braking_cause is not None:
            return True
        if have_actuators_failed or command is None:
            failed = BrakingCause.ACTUATOR_FAILED
            self.braking_cause = failed if have_actuators_failed else BrakingCause.NO_COMMAND
            return True
        lag = counter_lag(newer=state_counter, older=command.counter)
        self._has_reached_path |= abs(motion.off_path_m) < FARTHEST_OFF_PATH_M
        if max(now_ns - command.arrival_ns, lag * PERIOD_NS) > COMMAND_TIMEOUT_NS:
            self.braking_cause = BrakingCause.NO_COMMAND
        elif leaves_path(command.content, motion, self._has_reached_path):
            self.braking_cause = BrakingCause.LEAVING_PATH
        is_safe_stop = command.content.mode is Mode.SAFE_STOP
        self._safe_stop_ticks = self._safe_stop_ticks + 1 if is_safe_stop else 0
        if self.braking_cause is None:
            self.applied = command.content.control
            return False
        is_orderly = self._safe_stop_ticks > ORDERLY_TICKS and motion.speed_mps < ORDERLY_MPS
        self.has_controller_ended = is_orderly
        return True

    def brake(
        self, steer_rad: float, brake_n: float = MOST_BRAKE_N, is_wheel_stuck: bool = False
    ) -> None:
        """Set the input of a period in which the vehicle brakes.

        Args:
            steer_rad: wheel angle that leads along the path.
            brake_n: force that it brakes with.
            is_wheel_stuck: it brakes with the full force instead.
        """
        rate_n_per_s = BRAKE_RATE_N_PER_S
        if is_wheel_stuck:
            brake_n, rate_n_per_s = FULL_BRAKE_N, FULL_BRAKE_RATE_N_PER_S
        reached_n = min(self.applied.brake_n + rate_n_per_s * PERIOD_S, brake_n)
        self.applied = ControlInput(0.0, reached_n, steer_rad)


class Actuator(Enum):
    """An actuator of which the vehicle detects a failure, and how it shows."""

    STEERING_WHEEL = "the steering wheel does not move"
    THROTTLE = "the throttle stays open"


class FailedActuators:
    """Compares the inputs that were applied with the commanded ones."""

    def __init__(self) -> None:
        self.failed: list[Actuator] = []
        """in the order of detection"""
        self.open_throttle = 0.0
        """by which it was open too far in the last period"""
        self._steer_rad = self._moved_at_rad = NEUTRAL_INPUT.steer_rad
        self._ticks = dict.fromkeys(Actuator, 0)
        """in a row in which each has not followed its command"""

    def note(self, commanded: ControlInput, applied: ControlInput) -> None:
        """After a period."""
        is_still = abs(applied.steer_rad - self._steer_rad) < STILL_RAD
        if not is_still:
            self._moved_at_rad = commanded.steer_rad
        self._steer_rad = applied.steer_rad
        self.open_throttle = max(applied.throttle - commanded.throttle, 0.0)
        is_stuck = (
            is_still
            and abs(commanded.steer_rad - applied.steer_rad) > LARGEST_STEER_ERROR_RAD
            and abs(commanded.steer_rad - self._moved_at_rad) > LEAST_CHANGE_RAD
        )
        is_open = self.open_throttle > LARGEST_THROTTLE_ERROR
        for actuator, deviates in (
            (Actuator.STEERING_WHEEL, is_stuck),
            (Actuator.THROTTLE, is_open),
        ):
            self._ticks[actuator] = self._ticks[actuator] + 1 if deviates else 0
            if self._ticks[actuator] >= FAILED_TICKS and actuator not in self.failed:
                self.failed.append(actuator)
