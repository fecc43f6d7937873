"""The vehicle's end of the bus: commands in, one period of the car, state frames out."""

from collections import deque
from dataclasses import asdict
from math import inf
from typing import NamedTuple

import can
import numpy as np

from rt_controller.bus.identity import DISENGAGED_FRAMES, own_identity, require_same_catalogue
from rt_controller.bus.log.recorder import Recorder
from rt_controller.bus.messages import (
    CONTROLLER_IDENTITY,
    FEEDBACK,
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
from rt_controller.bus.send import Outbox
from rt_controller.contract.arrays import Array
from rt_controller.contract.braking import stop_speed_mps
from rt_controller.contract.errors import BusError
from rt_controller.contract.faults import NO_REFUSAL
from rt_controller.contract.signals import NEUTRAL_INPUT, Mode
from rt_controller.contract.timing import IDENT_PERIOD_TICKS, MISSION_PERIOD_TICKS, MISSION_VALID_NS
from rt_controller.drive.scenario import CarFigure
from rt_controller.vehicle.path_steering import Course, largest_brake_n, steer_along
from rt_controller.vehicle.vehicle_envelope import STANDING
from sim_bridge.car import FASTEST_MPS, Car
from sim_bridge.car_guard import Actuator, ActuatorWatchdog, CommandCheck, FailedActuators
from sim_bridge.faults.bus import FaultyBus
from sim_bridge.scenario import Scenario
from sim_bridge.scenario_run import ScenarioRun
from sim_bridge.summary import BridgeSummary

MISSION_ID = 1
END_TICKS = (DISENGAGED_FRAMES + 1) * MISSION_PERIOD_TICKS
"""the end of the mission counts when it was received several times"""
LONGEST_END_TICKS = 2 * END_TICKS
"""the same of a controller that drives on, because the mission takes longer on its way"""


class Delay(NamedTuple):
    """Periods from the instant of a state to the effect of the command that answers it."""

    transport_periods: int = 1
    """until the vehicle follows the command: bus and computing"""
    actuation_periods: int = 1
    """from there on until pedals and steering wheel move"""


DEFAULT_DELAY = Delay()


class Bridge:
    """One car in one scenario on one bus; `tick` is called once a period.

    The car waits at the start of the scenario, at its initial speed, until a controller drives.
    Faults act once it is driven.
    A command acts `delay` periods after the state that it answers.
    """

    def __init__(
        self,
        bus: can.BusABC,
        car: Car,
        scenario: Scenario,
        recorder: Recorder | None = None,
        delay: Delay = DEFAULT_DELAY,
        has_checks: bool = True,
    ) -> None:
        """Join a bus.

        Args:
            bus: the open bus.
            car: at the start.
            scenario: that it drives.
            recorder: of frames; None: they are not recorded.
            delay: from a state to the effect of the command that answers it.
            has_checks: False: no envelope of commands, no check of the path and the actuators.
        """
        self._faulty = FaultyBus(bus, scenario.faults, recorder) if scenario.faults else None
        self._bus = self._faulty or bus
        self._inbox = Inbox(Node.VEHICLE, recorder)
        sent = recorder if self._faulty is None else None  # else as the faults change it
        self._outbox = Outbox(self._bus, Node.VEHICLE, sent)
        self._car = car
        self.scenario = scenario
        self.plant_name = car.plant.name
        """of the own car that of its parameters"""
        self.run = ScenarioRun(scenario, car.state, car.s_m)
        """the car at the end of the last period, from the plant and not from the bus"""
        self._curvature = scenario.road.curvature_per_m
        self._check = CommandCheck(has_checks)
        self._has_checks = has_checks
        self._watchdog = ActuatorWatchdog()
        self._actuators = FailedActuators()
        self._in_transport = deque[Received[Command] | None]([None] * delay.transport_periods)
        self._in_actuation = deque([car.first_input] * delay.actuation_periods)
        self._command: Received[Command] | None = None
        """the newest one that has arrived"""
        self._mode: Mode | None = None
        """of the command that is followed; None: there was none"""
        self._poses = [(0, car.s_m, car.state.ey_m, car.state.epsi_rad)]
        self.applied = car.first_input
        """what pedals and steering wheel did in the last period"""
        self.has_failed = not car.is_sound
        """True if the motion is not finite or too fast; its states are sent as invalid"""
        self._sent_ticks = self._failed_ticks = 0
        self._stop_mps = inf
        self._has_driver = False
        """the mission is over, and the controller has released the car: a driver has taken it"""

    @property
    def is_over(self) -> bool:
        """True if the end of the mission, or of the plant, was sent often enough.

        A stop that began meanwhile is finished before.
        """
        if self._failed_ticks >= END_TICKS:
            return True
        is_driven = self._mode is not None and self._mode.drives and not self.is_braking
        is_stopping = self.is_braking or self._mode is Mode.SAFE_STOP
        ticks = LONGEST_END_TICKS if is_driven else END_TICKS
        return self.run.end_ticks >= ticks and not (is_stopping and self.run.is_moving)

    @property
    def is_waiting(self) -> bool:
        """True until a controller drives the car."""
        return self.run.ticks == 0

    @property
    def is_braking(self) -> bool:
        """True if the vehicle brakes by itself."""
        return self._watchdog.braking_cause is not None

    @property
    def has_refused(self) -> bool:
        """True if the vehicle does not follow the newest command."""
        return self._check.refusals != NO_REFUSAL

    def listen(self, now_ns: int) -> None:
        """Read the bus and send nothing: frames of a vehicle are those of another one.

        Raises:
            BusError: the bus cannot be read, or another vehicle is on it.
        """
        self._read(now_ns)
        if self._inbox.foreign_frames > 0:
            raise BusError(
                "Expected to be the only vehicle on this bus, found frames of another one. Stop it "
                "first, or choose another channel."
            )

    def tick(self, now_ns: int) -> None:
        """Read the newest command, advance the car by one period with it, send its state.

        A bus that fails while the car is driven is one on which nothing arrives: the car is braked.

        Raises:
            BusError: before the drive: the bus cannot be read, or the controller uses another
                message catalogue.
        """
        self._read(now_ns)
        if self.is_waiting:
            peer = self._inbox.newest(CONTROLLER_IDENTITY)
            if peer is not None:
                require_same_catalogue(peer.content)
        motion = STANDING if self.is_waiting else self.run.motion
        self._check.take(self._inbox, now_ns, self._sent_ticks - 1, motion)
        self._inbox.end_period(now_ns)
        self._in_transport.append(self._check.accepted)
        command = self._command = self._in_transport.popleft()
        self._mode = None if command is None else command.content.mode
        if self.has_failed:
            self._failed_ticks += 1
        elif not self.is_waiting or (self._mode is not None and self._mode.drives):
            self._advance(now_ns)
        self._send(now_ns)

    def require_readable_bus(self) -> None:
        """Raise a BusError if the bus could not be read."""
        self._inbox.require_readable()

    def end_mission(self) -> None:
        """End the mission with the next tick, as at the end of the scenario."""
        self.run.end_mission()

    def figures(self) -> tuple[CarFigure, ...]:
        """The figures that the scenario names or limits, so far."""
        return self.run.figures()

    def poses_at(self, times_ns: Array) -> Array:
        """(n, 3), s_m, ey_m, epsi_rad of the car itself, those of its last period at each time."""
        poses = np.array(self._poses)
        return np.asarray(poses[poses[:, 0].searchsorted(times_ns, "right") - 1, 1:])

    def faults_so_far(self) -> tuple[str, ...]:
        """What each fault of the scenario that has acted does, and when."""
        tick, faults = self.run.ticks, self.scenario.faults
        return tuple(f.text for f in faults if f.ticks.start <= tick or f.before_drive)

    def summary(self) -> BridgeSummary:
        """The figures so far."""
        ey_rms_m, ey_peak_m = self.run.ey_error_rms_and_peak_m()
        plant, cause = self._car.plant, self._watchdog.braking_cause
        failure = plant.failure or (
            f"{plant.name}: expected a finite motion of at most {FASTEST_MPS:g} m/s, found "
            f"{self._car.state.vx_mps:.4g} m/s"
        )
        return BridgeSummary(
            ticks=self.run.ticks,
            final_speed_mps=self.run.speed_mps,
            travelled_m=self.run.s_m,
            ey_rms_m=ey_rms_m,
            ey_peak_m=ey_peak_m,
            watchdog_braked=cause is not None,
            controller_ended=self._watchdog.has_controller_ended,
            refused_ticks=dict(self._check.refused_ticks),
            foreign_frames=self._inbox.foreign_frames,
            frames_received=asdict(self._inbox.counts),
            plant_failure=failure if self.has_failed else None,
            braking_cause=None if cause is None else cause.name,
            failed_actuators=tuple(each.name for each in self._actuators.failed),
            released=self._has_driver and cause is None,
        )

    def close(self) -> None:
        """Close the car's plant."""
        self._car.plant.close()

    def _read(self, now_ns: int) -> None:
        if self._faulty is not None:
            self._faulty.begin_reading(self.run.ticks)
        self._inbox.drain(self._bus, now_ns)
        if self.is_waiting:
            self.require_readable_bus()

    def _advance(self, now_ns: int) -> None:
        run, watchdog, actuators = self.run, self._watchdog, self._actuators
        if run.end_ticks > 0 and self._mode is Mode.STANDBY:
            self._has_driver = True
        wanted = NEUTRAL_INPUT
        if not self._has_driver or self.is_braking:
            motion = run.motion if self._has_checks else STANDING
            failed = actuators.failed if self._has_checks else []
            newest = self._sent_ticks - 1
            if watchdog.judge(self._command, now_ns, newest, motion, bool(failed)):
                course = Course(run.path, run.state, run.curvature_per_m)
                before_rad = watchdog.applied.steer_rad  # commanded: a late wheel is behind it
                self._stop_mps = stop_speed_mps(self._stop_mps, run.state.vx_mps)
                watchdog.brake(
                    steer_along(*course, before_rad),
                    largest_brake_n(
                        course, before_rad, actuators.open_throttle, stop_mps=self._stop_mps
                    ),
                    Actuator.STEERING_WHEEL in failed,
                )
            wanted = watchdog.applied
        self._in_actuation.append(wanted)
        commanded = self.applied = self._in_actuation.popleft()
        if self._faulty is not None:
            self.applied = self._faulty.actuated(commanded, run.ticks + 1)
        actuators.note(commanded, self.applied)
        self.has_failed = not run.drive(self._car, self.applied, self._mode, self.is_braking)
        if not self.has_failed:
            state = self._car.state
            self._poses.append((now_ns, self._car.s_m, state.ey_m, state.epsi_rad))

    def _send(self, now_ns: int) -> None:
        command, run, send = self._command, self.run, self._outbox.send
        age_s = 0.0 if self._faulty is None else self._faulty.sample_age_s(run.ticks)
        state, s_m, path = run.sample(age_s)
        sample = StateSample(
            state=self._car.state if self.has_failed else state,
            curvature_per_m=self._curvature.at(s_m),
            sample_time_ns=now_ns - round(1e9 * age_s),
            command_echo=None if command is None else command.counter,
            is_watchdog_braking=self.is_braking,
            refusals=self._check.refusals,
        )
        counter = self._sent_ticks  # counts on while frames are lost
        if self._faulty is not None:
            self._faulty.begin_sending(run.ticks, now_ns)
        send(STATE, sample, now_ns, counter=counter, is_valid=not self.has_failed)
        send(REFERENCE, path, now_ns, counter=counter)
        ahead = self.scenario.preview_ahead(s_m, state.vx_mps, path.v_mps, run.time_s - age_s)
        send(PREVIEW, ahead, now_ns, counter=counter)
        if not self.is_waiting or self.applied != NEUTRAL_INPUT:
            send(FEEDBACK, self.applied, now_ns)
        if counter % MISSION_PERIOD_TICKS == 0:
            send(MISSION, Mission(run.end_ticks == 0, False, MISSION_ID, MISSION_VALID_NS), now_ns)
        if counter % IDENT_PERIOD_TICKS == 0:
            send(VEHICLE_IDENTITY, own_identity(None), now_ns)
        if self._faulty is not None:
            self._faulty.end_sending()
        self._sent_ticks += 1
