"""The vehicle's end of the bus: commands in, one period of the car, state frames out."""

from dataclasses import dataclass
from math import atan, hypot

import can

from rt_controller.bus.catalogue import (
    COMMAND,
    CONTROLLER_IDENTITY,
    FEEDBACK,
    MISSION,
    PREVIEW,
    REFERENCE,
    STATE,
    VEHICLE_IDENTITY,
    Command,
    Mission,
    StateSample,
)
from rt_controller.bus.identity import own_identity, require_same_catalogue
from rt_controller.bus.inbox import Inbox, Received
from rt_controller.bus.message import Node
from rt_controller.bus.outbox import Outbox
from rt_controller.bus.recorder import Recorder
from rt_controller.car_figures import CarFigure
from rt_controller.contract.errors import BusError
from rt_controller.contract.signals import NEUTRAL_INPUT, Mode, VehicleState
from rt_controller.contract.timing import IDENT_PERIOD_TICKS, MISSION_PERIOD_TICKS, PERIOD_S
from sim_bridge.car import FASTEST_MPS, Car
from sim_bridge.faults import FaultInjector
from sim_bridge.scenario import Scenario
from sim_bridge.scenario.faults import FaultKind
from sim_bridge.scenario.metrics import DriveLog, LogRow, judged, measure, peak, rms
from sim_bridge.scenario.speed import next_progress
from sim_bridge.watchdog import ActuatorWatchdog

MISSION_ID = 1
MISSION_VALID_NS = 500_000_000
END_TICKS = 2 * MISSION_PERIOD_TICKS
"""the end of the mission is sent more than once"""
AT_REST_MPS = 0.3
"""speed below which a safe stop has brought the car to rest, as for the controller"""


@dataclass(frozen=True, slots=True)
class BridgeSummary:
    """Figures of the run from the car itself, not from the bus."""

    ticks: int
    final_speed_mps: float
    travelled_m: float
    ey_rms_m: float
    ey_peak_m: float
    watchdog_braked: bool
    controller_ended: bool
    """the watchdog braked after a safe stop of the controller, and not while it drove"""
    plant_failure: str | None
    """why the motion is not finite or too fast; the figures are those before it"""


class Bridge:
    """One car in one scenario on one bus; `tick` is called once a period.

    The car waits at the start of the scenario, at its initial speed, until a controller drives.
    Faults act once it is driven.
    A command computed from the state of one tick acts from that tick on: the delay of
    transport and computing, two to three milliseconds of the 25, is not simulated.
    """

    def __init__(
        self, bus: can.BusABC, car: Car, scenario: Scenario, recorder: Recorder | None = None
    ) -> None:
        self._bus = bus
        self._inbox = Inbox(Node.VEHICLE, recorder)
        self._outbox = Outbox(bus, Node.VEHICLE, recorder)
        self._car = car
        self.scenario = scenario
        self._faults = FaultInjector(scenario.faults)
        self._curvature = scenario.road.frame()
        self._progress = scenario.first_progress
        self._log = DriveLog()
        self._command: Received[Command] | None = None
        """the newest command that reached the vehicle"""
        self._watchdog = ActuatorWatchdog()
        self._applied = NEUTRAL_INPUT
        self._state: VehicleState = car.state
        self._s_m = car.s_m
        self._path = scenario.path_ahead(car.s_m, car.state.vx_mps)
        """what a path planner sends from where the car is"""
        self._sent_ticks = 0
        self._end_ticks = 0
        """ticks since the end of the mission"""
        self._has_driver = False
        """the mission is over, and the controller has released the car: a driver has taken it"""
        self._failed_ticks = 0
        self.driven_ticks = 0

    @property
    def is_over(self) -> bool:
        """True if the end of the mission, or of the plant, was sent often enough."""
        return max(self._end_ticks, self._failed_ticks) >= END_TICKS

    @property
    def is_waiting(self) -> bool:
        """True until a controller drives the car."""
        return self.driven_ticks == 0

    @property
    def has_failed(self) -> bool:
        """True if the motion is not finite or too fast; its states are sent as invalid."""
        return not self._car.is_sound

    @property
    def plant_name(self) -> str:
        """Name of the plant; of the own car that of its parameters."""
        return self._car.plant.name

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

        Raises:
            BusError: the bus cannot be read, or the controller uses another message catalogue.
        """
        self._read(now_ns)
        peer = self._inbox.newest(CONTROLLER_IDENTITY)
        if peer is not None:
            require_same_catalogue(peer.content)
        if not self._faults.acts(FaultKind.COMMAND_LOST, self.driven_ticks):
            self._command = self._inbox.newest(COMMAND)
        command = self._command
        is_driven = command is not None and command.content.mode.drives
        if self.has_failed:
            self._failed_ticks += 1
        elif self.driven_ticks > 0 or is_driven:
            self._advance(now_ns)
        self._send(now_ns)

    @property
    def time_s(self) -> float:
        """Time since the car was first driven."""
        return self.driven_ticks * PERIOD_S

    def figures(self) -> tuple[CarFigure, ...]:
        """The figures that the scenario names or limits, so far."""
        found = measure(
            self._log, self.scenario.stops, self.scenario.course, self.scenario.road.width_m
        )
        return judged(found, self.scenario.metrics, self.scenario.limits)

    def faults_so_far(self) -> tuple[str, ...]:
        """Kind and begin of each fault of the scenario that has acted."""
        return self._faults.acted(self.driven_ticks)

    def summary(self) -> BridgeSummary:
        """The figures so far."""
        ey_error_m = self._log.ey_error_m()
        plant = self._car.plant
        failure = plant.failure or (
            f"{plant.name}: expected a finite motion of at most {FASTEST_MPS:g} m/s, found "
            f"{self._car.state.vx_mps:.4g} m/s"
        )
        return BridgeSummary(
            ticks=self.driven_ticks,
            final_speed_mps=self._speed_mps(),
            travelled_m=self._s_m,
            ey_rms_m=rms(ey_error_m),
            ey_peak_m=peak(ey_error_m),
            watchdog_braked=self._watchdog.is_braking,
            controller_ended=self._watchdog.has_controller_ended,
            plant_failure=failure if self.has_failed else None,
        )

    def close(self) -> None:
        """Close the car's plant."""
        self._car.plant.close()

    def _read(self, now_ns: int) -> None:
        self._inbox.drain(self._bus, now_ns)
        self._inbox.require_readable()

    def _advance(self, now_ns: int) -> None:
        if self._end_ticks > 0 and self._mode is Mode.STANDBY:
            self._has_driver = True
        if self._has_driver and not self._watchdog.is_braking:
            self._applied = NEUTRAL_INPUT
        else:
            self._applied = self._watchdog.apply(
                self._command,
                now_ns,
                self._sent_ticks - 1,
                self._speed_mps(),
            )
        self._car.set_road(self.scenario.road_at(self._s_m, self.time_s))
        state = self._car.advance(self._applied, self._curvature)
        if self.has_failed:
            return
        self._state, self._s_m = state, self._car.s_m
        self.driven_ticks += 1
        self._progress = next_progress(
            self._progress, self.scenario.stops, self._s_m, state.vx_mps, self.time_s
        )
        self._path = self.scenario.path_ahead(self._s_m, state.vx_mps, self.time_s, self._progress)
        if self._is_mission_on():
            self._judge(state)
        else:
            self._end_ticks += 1

    def _speed_mps(self) -> float:
        return hypot(self._state.vx_mps, self._state.vy_mps)

    def _is_mission_on(self) -> bool:
        """True during the scenario, and after it until a safe stop has brought the car to rest."""
        if self._end_ticks > 0:
            return False
        is_moving = self._state.vx_mps > AT_REST_MPS
        if self._watchdog.is_braking:
            return is_moving
        is_on = self.driven_ticks < self.scenario.ticks and self._s_m < self.scenario.end_m
        return is_on or (self._mode is Mode.SAFE_STOP and is_moving)

    @property
    def _mode(self) -> Mode | None:
        """Of the newest command; None: there was none."""
        return None if self._command is None else self._command.content.mode

    def _judge(self, state: VehicleState) -> None:
        """Add one period to the figures."""
        path = self._path
        self._log.add(
            LogRow(
                time_s=self.time_s,
                s_m=self._s_m,
                ey_m=state.ey_m,
                epsi_rad=state.epsi_rad,
                curvature_per_m=self.scenario.road.curvature_per_m.at(self._s_m),
                vx_mps=state.vx_mps,
                vy_mps=state.vy_mps,
                yaw_rate_radps=state.yaw_rate_radps,
                steer_rad=self._applied.steer_rad,
                wanted_ey_m=path.c0_m,
                wanted_epsi_rad=atan(path.c1),
                wanted_mps=path.v_mps,
                stop=self._progress.stops_done if self._progress.is_holding else -1,
            )
        )

    def _send(self, now_ns: int) -> None:
        command = self._command
        sample = StateSample(
            state=self._car.state,
            curvature_per_m=self.scenario.road.curvature_per_m.at(self._s_m),
            sample_time_ns=now_ns,
            command_echo=None if command is None else command.counter,
            is_watchdog_braking=self._watchdog.is_braking,
        )
        send, acts, tick = self._outbox.send, self._faults.acts, self.driven_ticks
        counter = self._sent_ticks  # counts on while frames are lost
        sample = self._faults.sample(sample, tick)
        if not acts(FaultKind.STATE_LOST, tick):
            is_valid = not (self.has_failed or acts(FaultKind.STATE_INVALID, tick))
            send(STATE, sample, now_ns, counter=counter, is_valid=is_valid)
        if not acts(FaultKind.REFERENCE_LOST, tick):
            send(REFERENCE, self._path, now_ns, counter=counter)
        if not acts(FaultKind.PREVIEW_LOST, tick):
            vx_mps = self._state.vx_mps
            preview = self.scenario.preview_ahead(self._s_m, vx_mps, self._path.v_mps)
            send(PREVIEW, preview, now_ns, counter=counter)
        if self.driven_ticks > 0:
            send(FEEDBACK, self._applied, now_ns)
        is_mission_due = self._sent_ticks % MISSION_PERIOD_TICKS == 0
        if is_mission_due and not acts(FaultKind.MISSION_LOST, tick):
            mission = Mission(
                is_engaged=self._end_ticks == 0,
                is_reset_requested=False,
                mission_id=MISSION_ID,
                valid_for_ns=MISSION_VALID_NS,
            )
            send(MISSION, mission, now_ns)
        if self._sent_ticks % IDENT_PERIOD_TICKS == 0:
            send(VEHICLE_IDENTITY, own_identity(None), now_ns)
        self._sent_ticks += 1
