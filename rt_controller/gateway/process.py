"""The gateway as a process of its own, between the car's bus and a bus of the contract.

The controller on the other bus is unchanged. Its commands pass the vehicle's envelope here, and are
limited once more. If they stop, are refused, or lead the car off its path, the gateway brakes it.
"""

import time
from dataclasses import dataclass, field
from math import hypot, inf
from typing import Any

import can

from rt_controller.bus.messages import Command
from rt_controller.bus.receive import Received
from rt_controller.contract.braking import BRAKE_RATE_N_PER_S, stop_speed_mps
from rt_controller.contract.car import DEFAULT_CAR, Car
from rt_controller.contract.errors import BusError
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, Mode
from rt_controller.contract.timing import (
    COMMAND_TIMEOUT_NS,
    COMMAND_TIMEOUT_TICKS,
    PERIOD_NS,
    PERIOD_S,
    counter_lag,
)
from rt_controller.gateway.car_end import CarEnd
from rt_controller.mapping.car_file import CarFile
from rt_controller.mapping.lateral_speed import LateralSpeed
from rt_controller.mapping.signal_frames import MAX_FRAMES
from rt_controller.realtime.clock import RealtimeClock
from rt_controller.safety.envelope import limit
from rt_controller.safety.modes import STANDING_MPS
from rt_controller.safety.stop import ALONG_PATH, Braking, safe_stop, stand_by
from rt_controller.vehicle.braking_cause import BrakingCause
from rt_controller.vehicle.path_steering import largest_brake_n, steer_along
from rt_controller.vehicle.vehicle_envelope import (
    FARTHEST_OFF_PATH_M,
    STANDING,
    OwnMotion,
    leaves_path,
    off_path_m,
    refusals,
)

POLLS = 10
"""of both buses in a period, so that a command is late by 2.5 ms at most"""
ROUNDING = ControlInput(throttle=1e-4, brake_n=0.01, steer_rad=4e-4)
"""two commands that differ by less are equal within the resolution of a frame"""
LEAVING_REQUEST = 3
"""request to end after which the gateway ends at once; those before it brake the car"""
LONGEST_STOP_WITHOUT_SPEED_TICKS = round(10.0 / PERIOD_S)
"""after so long a stop without a speed the car counts as standing, as in the controller"""


@dataclass(slots=True)
class GatewayCounts:
    """Figures of a run."""

    ticks: int = 0
    skipped_ticks: int = 0
    commands: int = 0
    """passed on to the car"""
    limited: int = 0
    """of these: not passed on as received, but with the nearest values that may follow"""
    refused: int = 0
    """not passed on: the car keeps the command before"""
    refused_because: dict[str, int] = field(default_factory=dict)
    """of these, for each reason in VehicleFaults"""
    brakings: int = 0
    """times that the gateway braked the car by itself"""
    braked_because: dict[str, int] = field(default_factory=dict)
    """of these, for each `BrakingCause`"""
    send_failures: int = 0
    """frames that the car's bus did not take"""


class Gateway:
    """Translates between both buses; call `exchange` often and `tick` once a period."""

    def __init__(
        self,
        car_bus: can.BusABC,
        bus: can.BusABC,
        car: CarFile,
        lateral_speed: LateralSpeed,
        description: Car = DEFAULT_CAR,
    ) -> None:
        """Nothing is sent yet.

        Args:
            car_bus: with the car's own messages.
            bus: with those of the contract.
            car: its mapping.
            lateral_speed: estimates v_y where the car does not send it.
            description: of the car.
        """
        self.car_end = CarEnd(car, lateral_speed, bus)
        self.counts = GatewayCounts()
        self._car_bus = car_bus
        self._bus = bus
        self._description = description
        self._last_read_ns = 0
        self._applied = NEUTRAL_INPUT
        self._stop_mps = inf
        self._mode = Mode.STANDBY
        """of the newest command that was passed on"""
        self._motion = STANDING
        self._has_reached_path = False
        self._ticks_without_course = 0
        self.requests = 0
        """to end"""

    def request_end(self) -> None:
        """Request the end of the gateway; may be called in a signal handler."""
        self.requests += 1

    @property
    def has_ended(self) -> bool:
        """True after a request once the car is not driven or stands; at once after the third."""
        is_at_rest = self._motion.speed_mps < STANDING_MPS
        if self._ticks_without_course:
            is_at_rest = self._ticks_without_course > LONGEST_STOP_WITHOUT_SPEED_TICKS
        may_end = self._mode is Mode.STANDBY or is_at_rest
        return self.requests >= LEAVING_REQUEST or (self.requests > 0 and may_end)

    def exchange(self, now_ns: int, *, has_wall_clock: bool = True) -> None:
        """Read both buses; a new command goes to the car at once.

        Raises:
            can.CanError: a bus cannot be read.
        """
        self._read_car(now_ns, has_wall_clock)
        self._last_read_ns = now_ns
        while (frame := self._bus.recv(0)) is not None:
            before = self.car_end.command
            if self.car_end.accept_command(frame, now_ns) and not self.car_end.is_braking:
                self._pass_on(before, now_ns)

    def _read_car(self, now_ns: int, has_wall_clock: bool) -> None:
        """Pass the waiting frames of the car's bus to its end.

        A frame arrived between the last call and this one. Where frames have time stamps of this
        machine, these say when; a clock that was set cannot make it earlier or later than that.
        """
        wall_s = time.time() if has_wall_clock else 0.0
        for _ in range(MAX_FRAMES):
            frame: Any = self._car_bus.recv(0)
            if frame is None:
                return
            age_ns = round(1e9 * (wall_s - frame.timestamp)) if has_wall_clock else 0
            age_ns = min(max(age_ns, 0), now_ns - self._last_read_ns)
            self.car_end.accept(frame, now_ns - age_ns)

    def require_alone(self) -> None:
        """Return if each message has one sender, or the car is driven.

        A driven car is braked.

        Raises:
            BusError: another node does, such as a second gateway or a simulated car; or two nodes
                send one message of the car.
        """
        if self.car_end.message_of_two and self._mode is Mode.STANDBY:
            raise BusError(
                f"Expected one sender of each message of the car, found "
                f"{self.car_end.message_of_two}."
            )
        if self.car_end.foreign_frames and self._mode is Mode.STANDBY:
            raise BusError(
                f"Expected that only this gateway sends the messages of the vehicle and the "
                f"commands for the car, found {self.car_end.foreign_frames} such frames of another "
                f"node. End the other gateway or simulated car, or disconnect the control unit "
                f"whose messages this one replaces."
            )

    def tick(self, now_ns: int, skipped: int = 0) -> None:
        """Send the states of one period; brake the car if its commands may not be followed."""
        self.counts.ticks += 1
        self.counts.skipped_ticks += skipped
        self._watch(now_ns)
        self.car_end.send(now_ns, skipped)
        self._measure()

    def _pass_on(self, before: Received[Command] | None, now_ns: int) -> None:
        """Send the newest command to the car, or the one before once more."""
        car_end, counts = self.car_end, self.counts
        command = car_end.command
        if command is None:
            return
        last, periods = self._applied, COMMAND_TIMEOUT_TICKS
        if before is not None and self._mode is not Mode.STANDBY:
            last, periods = before.content.control, counter_lag(command.counter, before.counter)
        is_requested = self._is_driven(now_ns) and not self._has_driver(now_ns)
        motion = self._motion._replace(is_mission_on=is_requested)
        found = refusals(command.content, last, periods, motion, self._description)
        car_end.refusals = found
        if found:
            car_end.command = before
            counts.refused += 1
            for name in (refusal.name or "" for refusal in found):
                counts.refused_because[name] = counts.refused_because.get(name, 0) + 1
        else:
            driver, mode = car_end.reported(now_ns), command.content.mode
            is_takeover = self._mode is Mode.STANDBY and mode is not Mode.STANDBY
            if is_takeover and driver is not None:  # who may hand over a pressed pedal
                pedals = {"throttle": driver.throttle, "brake_n": driver.brake_n}
                self._applied = self._applied._replace(**pedals)
            self._applied = self._limit(command.content.control)
            self._mode = command.content.mode
            counts.commands += 1
            differences = zip(self._applied, command.content.control, ROUNDING, strict=True)
            counts.limited += any(abs(a - b) > step for a, b, step in differences)
        self._send(self._applied, self._mode)

    def _limit(self, control: ControlInput) -> ControlInput:
        """The input nearest to it that may follow the last one."""
        speed_mps = self._motion.speed_mps
        car = self._description
        largest_rad = car.geometry.largest_wheel_rad(speed_mps, car.largest_lateral_mps2)
        return limit(control, self._applied, car.limits.with_wheel(largest_rad))

    def _watch(self, now_ns: int) -> None:
        """Brake a car whose commands may not be followed; go on releasing one that was released."""
        car_end = self.car_end
        age_ns = car_end.age_ns(now_ns)
        is_silent = age_ns is not None and age_ns > COMMAND_TIMEOUT_NS
        cause = self._cause_to_brake(now_ns, is_silent)
        if self._mode is not Mode.STANDBY and (car_end.is_braking or cause is not None):
            if not self._is_driven(now_ns):
                car_end.is_braking, self._mode = False, Mode.STANDBY
            elif cause is not None and not car_end.is_braking:
                car_end.is_braking, self._stop_mps = True, inf
                because = self.counts.braked_because
                self.counts.brakings += 1
                because[cause.name] = because.get(cause.name, 0) + 1
        if car_end.is_braking:
            self._applied = self._limit(self._stop())
            self._send(self._applied, Mode.SAFE_STOP)
        elif is_silent:
            # A message with a long period, or a turned wheel, needs more frames than were received.
            self._applied = self._limit(stand_by(self._applied))
            self._send(self._applied, Mode.STANDBY)

    def _cause_to_brake(self, now_ns: int, is_silent: bool) -> BrakingCause | None:
        """None: the commands may be followed on. A driver may steer the car off its path."""
        if is_silent:
            return BrakingCause.NO_COMMAND
        if self.car_end.follows(now_ns) is None:
            return BrakingCause.CAR_UNKNOWN
        if self.car_end.foreign_frames or self.car_end.message_of_two:
            return BrakingCause.SECOND_SENDER
        command = self.car_end.command
        if command is not None and not self._has_driver(now_ns):
            motion = self._motion._replace(is_mission_on=self._is_driven(now_ns))
            if leaves_path(command.content, motion, self._has_reached_path):
                return BrakingCause.LEAVING_PATH
        return BrakingCause.END_REQUESTED if self.requests > 0 else None

    def _measure(self) -> None:
        """Store the motion of the car by its own signals."""
        course = self.car_end.course
        if course is None:
            self._ticks_without_course += 1
            self._motion = self._motion._replace(off_path_m=0.0)
            return
        self._ticks_without_course = 0
        state = course.state
        self._motion = OwnMotion(hypot(state.vx_mps, state.vy_mps), off_path_m(*course), True)
        is_near = abs(self._motion.off_path_m) < FARTHEST_OFF_PATH_M
        is_driven = self._mode is not Mode.STANDBY
        self._has_reached_path = is_driven and (self._has_reached_path or is_near)

    def _is_driven(self, now_ns: int) -> bool:
        """True if the car is driven and `engage` is on or missing."""
        is_engaged = self.car_end.samples.is_on("mission.engage", now_ns)
        return self._mode is not Mode.STANDBY and is_engaged is not False

    def _has_driver(self, now_ns: int) -> bool:
        """True if the car reports that it does not follow the commands."""
        return self.car_end.follows(now_ns) is False

    def _stop(self) -> ControlInput:
        """Input of one period of a stop along the path; without one the wheel returns to zero."""
        course, before = self.car_end.course, self._applied
        if course is None:
            along_path = ALONG_PATH.scaled(self._description.force_scale)
            return safe_stop(before, None, True, along_path)
        self._stop_mps = stop_speed_mps(self._stop_mps, course.state.vx_mps)
        steer_rad = steer_along(*course, before.steer_rad, self._description)
        force_n = largest_brake_n(
            course, before.steer_rad, car=self._description, stop_mps=self._stop_mps
        )
        braking = Braking(force_n, BRAKE_RATE_N_PER_S * self._description.force_scale)
        return safe_stop(before, before._replace(steer_rad=steer_rad), False, braking)

    def end(self) -> None:
        """Send the last command in every message, whatever its period."""
        if self.counts.commands:
            mode = Mode.SAFE_STOP if self.car_end.is_braking else self._mode
            self._send_frames(self.car_end.last_frames(self._applied, mode))

    def _send(self, control: ControlInput, mode: Mode) -> None:
        self._send_frames(self.car_end.command_frames(control, mode))

    def _send_frames(self, frames: list[can.Message]) -> None:
        for frame in frames:
            try:
                self._car_bus.send(frame, timeout=0)
            except can.CanError:
                self.counts.send_failures += 1


def run_gateway(gateway: Gateway) -> None:
    """Translate in real time until an end is requested, and a car that is driven stands.

    Raises:
        BusError: a bus cannot be read.
    """
    clock = RealtimeClock()
    try:
        while not gateway.has_ended:
            for poll in range(POLLS - 1, 0, -1):
                clock.sleep_until_before_tick(poll * PERIOD_NS // POLLS)
                gateway.exchange(clock.now_ns())
            tick = clock.wait()
            gateway.exchange(clock.now_ns())
            gateway.require_alone()
            gateway.tick(clock.now_ns(), tick.skipped)
        gateway.end()
    except can.CanError as error:
        raise BusError(
            f"A bus of the gateway cannot be read: expected frames or silence, found {error}. "
            f"Check the interfaces, then start again."
        ) from error
