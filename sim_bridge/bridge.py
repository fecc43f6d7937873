"""The vehicle's end of the bus: commands in, one period of the car, state frames out."""

from dataclasses import dataclass
from math import hypot

import can

from rt_controller.bus.catalogue import (
    COMMAND,
    CONTROLLER_IDENTITY,
    FEEDBACK,
    MISSION,
    REFERENCE,
    STATE,
    VEHICLE_IDENTITY,
    Mission,
    StateSample,
)
from rt_controller.bus.identity import own_identity, require_same_catalogue
from rt_controller.bus.inbox import Inbox
from rt_controller.bus.message import Node
from rt_controller.bus.outbox import Outbox
from rt_controller.bus.recorder import Recorder
from rt_controller.contract.errors import BusError
from rt_controller.contract.signals import NEUTRAL_INPUT, Mode, VehicleState
from rt_controller.contract.timing import IDENT_PERIOD_TICKS, MISSION_PERIOD_TICKS
from sim_bridge.car import Car
from sim_bridge.scenario import Scenario
from sim_bridge.watchdog import ActuatorWatchdog

MISSION_ID = 1
MISSION_VALID_NS = 500_000_000
END_TICKS = 2 * MISSION_PERIOD_TICKS
"""the end of the mission is sent more than once"""
STANDING_MPS = 0.3


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
    """why the plant stopped returning finite numbers; the figures are those before it"""


class Bridge:
    """One car in one scenario on one bus; `tick` is called once a period.

    The car waits at the start of the scenario, at its wanted speed, until a controller drives.
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
        self._scenario = scenario
        self._watchdog = ActuatorWatchdog()
        self._applied = NEUTRAL_INPUT
        self._state: VehicleState = car.state
        self._s_m = car.s_m
        self._sent_ticks = 0
        self._end_ticks = 0
        """ticks since the end of the mission"""
        self._failed_ticks = 0
        self._ey_square_m2 = 0.0
        self._ey_peak_m = 0.0
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
        """True if the plant stopped returning finite numbers; its states are sent as invalid."""
        return not self._car.is_sound

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
        command = self._inbox.newest(COMMAND)
        is_driven = command is not None and command.content.mode is Mode.NOMINAL
        if self.has_failed:
            self._failed_ticks += 1
        elif self.driven_ticks > 0 or is_driven:
            self._advance(now_ns)
        self._send(now_ns)

    def summary(self) -> BridgeSummary:
        """The figures so far."""
        ticks = max(self.driven_ticks, 1)
        plant = self._car.plant
        failure = plant.failure or f"{plant.name}: its motion left all bounds"
        return BridgeSummary(
            ticks=self.driven_ticks,
            final_speed_mps=self._speed_mps(),
            travelled_m=self._s_m,
            ey_rms_m=(self._ey_square_m2 / ticks) ** 0.5,
            ey_peak_m=self._ey_peak_m,
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
        if self._end_ticks > 0 and not self._watchdog.is_braking:
            self._applied = NEUTRAL_INPUT  # the mission is over: a driver has taken the car
        else:
            self._applied = self._watchdog.apply(
                self._inbox.newest(COMMAND),
                now_ns,
                self._outbox.last_counter(STATE),
                self._speed_mps(),
            )
        state = self._car.advance(self._applied, self._scenario.curvature_per_m)
        if self.has_failed:
            return
        self._state, self._s_m = state, self._car.s_m
        self.driven_ticks += 1
        if self._is_mission_on():
            error_m = self._state.ey_m - self._scenario.path_ahead(self._s_m, 0.0).c0_m
            self._ey_square_m2 += error_m**2
            self._ey_peak_m = max(self._ey_peak_m, abs(error_m))
        else:
            self._end_ticks += 1

    def _speed_mps(self) -> float:
        return hypot(self._state.vx_mps, self._state.vy_mps)

    def _is_mission_on(self) -> bool:
        """True during the scenario, and after it until a safe stop has brought the car to rest."""
        if self._end_ticks > 0:
            return False
        is_moving = self._state.vx_mps > STANDING_MPS
        if self._watchdog.is_braking:
            return is_moving
        command = self._inbox.newest(COMMAND)
        is_safe_stop = command is not None and command.content.mode is Mode.SAFE_STOP
        return self.driven_ticks < self._scenario.ticks or (is_safe_stop and is_moving)

    def _send(self, now_ns: int) -> None:
        command = self._inbox.newest(COMMAND)
        sample = StateSample(
            state=self._car.state,
            curvature_per_m=self._scenario.curvature_per_m,
            sample_time_ns=now_ns,
            command_echo=None if command is None else command.counter,
            is_watchdog_braking=self._watchdog.is_braking,
        )
        send = self._outbox.send
        send(STATE, sample, now_ns, is_valid=not self.has_failed)
        send(REFERENCE, self._scenario.path_ahead(self._s_m, self._state.vx_mps), now_ns)
        if self.driven_ticks > 0:
            send(FEEDBACK, self._applied, now_ns)
        if self._sent_ticks % MISSION_PERIOD_TICKS == 0:
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
