"""The vehicle's end of the bus: commands in, one period of the car, state frames out."""

from dataclasses import dataclass
from math import hypot

import can

from rt_controller.bus.frames import Mission, RoadSample
from rt_controller.bus.identity import require_same_catalogue
from rt_controller.bus.inbox import CommandInbox
from rt_controller.bus.outbox import VehicleOutbox
from rt_controller.contract.errors import BusError
from rt_controller.contract.signals import NEUTRAL_INPUT, VehicleState
from rt_controller.contract.timing import IDENT_PERIOD_TICKS, MISSION_PERIOD_TICKS
from sim_bridge.car import Car
from sim_bridge.scenario import Scenario
from sim_bridge.watchdog import ActuatorWatchdog, is_driving

MISSION_ID = 1
MISSION_VALID_NS = 500_000_000
FAREWELL_TICKS = 2 * MISSION_PERIOD_TICKS
"""the end of the mission is said more than once"""
STANDING_MPS = 0.3


@dataclass(frozen=True, slots=True)
class BridgeSummary:
    """What the car knows of the run, without the bus in between."""

    ticks: int
    final_speed_mps: float
    travelled_m: float
    ey_rms_m: float
    ey_peak_m: float
    watchdog_braked: bool
    plant_failure: str | None
    """why the plant stopped giving numbers; the figures are those of before"""


class Bridge:
    """One car in one scenario on one bus; `tick` is called once a period.

    The car waits at the start of the scenario, at its wanted speed, until a controller drives.
    A command computed from the state of one tick acts from that tick on: transport and computing
    time, a few per cent of the period, are not simulated.
    """

    def __init__(
        self,
        *,
        bus: can.BusABC,
        inbox: CommandInbox,
        outbox: VehicleOutbox,
        car: Car,
        scenario: Scenario,
    ) -> None:
        self._bus = bus
        self._inbox = inbox
        self._outbox = outbox
        self._car = car
        self._scenario = scenario
        self._watchdog = ActuatorWatchdog()
        self._applied = NEUTRAL_INPUT
        self._state: VehicleState = car.state
        self._s_m = car.s_m
        self._sent_ticks = 0
        self._farewell_ticks = 0
        self._failed_ticks = 0
        self._ey_square_m2 = 0.0
        self._ey_peak_m = 0.0
        self.driven_ticks = 0

    @property
    def is_over(self) -> bool:
        """Whether the end of the mission, or of the plant, has been said often enough."""
        return max(self._farewell_ticks, self._failed_ticks) >= FAREWELL_TICKS

    @property
    def is_waiting(self) -> bool:
        """Whether no controller has taken the car yet."""
        return self.driven_ticks == 0

    @property
    def has_failed(self) -> bool:
        """Whether the plant has stopped giving numbers; invalid states are told from then on."""
        return not self._car.is_sound

    def tick(self, now_ns: int) -> None:
        """Hear the newest command, let the car drive one period with it, tell its state.

        Raises:
            BusError: the bus cannot be read, or the controller speaks another message catalogue.
        """
        self._inbox.drain(self._bus, now_ns)
        if self._inbox.last_failure:
            raise BusError(f"The bus cannot be read: {self._inbox.last_failure}")
        if self._inbox.peer is not None:
            require_same_catalogue(self._inbox.peer)
        if self.has_failed:
            self._failed_ticks += 1
        elif self.driven_ticks > 0 or is_driving(self._inbox.command):
            self._drive(now_ns)
        self._tell(now_ns)

    def summary(self) -> BridgeSummary:
        """So far."""
        ticks = max(self.driven_ticks, 1)
        return BridgeSummary(
            ticks=self.driven_ticks,
            final_speed_mps=hypot(self._state.vx_mps, self._state.vy_mps),
            travelled_m=self._s_m,
            ey_rms_m=(self._ey_square_m2 / ticks) ** 0.5,
            ey_peak_m=self._ey_peak_m,
            watchdog_braked=self._watchdog.is_braking,
            plant_failure=self._failure(),
        )

    def close(self) -> None:
        """Let the car go."""
        self._car.close()

    def _drive(self, now_ns: int) -> None:
        if self._farewell_ticks > 0 and not self._watchdog.is_braking:
            self._applied = NEUTRAL_INPUT  # the mission is over: a driver has taken the car
        else:
            self._applied = self._watchdog.apply(
                self._inbox.command, now_ns, self._outbox.last_state_counter
            )
        state = self._car.advance(self._applied, self._scenario.curvature_per_m)
        if self.has_failed:
            return
        self._state, self._s_m = state, self._car.s_m
        self.driven_ticks += 1
        if self._mission_is_on():
            error_m = self._state.ey_m - self._scenario.path_ahead(self._s_m, 0.0).c0_m
            self._ey_square_m2 += error_m**2
            self._ey_peak_m = max(self._ey_peak_m, abs(error_m))
        else:
            self._farewell_ticks += 1

    def _failure(self) -> str | None:
        if not self.has_failed:
            return None
        return self._car.plant.failure or f"{self._car.plant.name}: its motion left all bounds"

    def _mission_is_on(self) -> bool:
        if self._watchdog.is_braking:
            return self._state.vx_mps > STANDING_MPS
        return self.driven_ticks < self._scenario.ticks

    def _tell(self, now_ns: int) -> None:
        command = self._inbox.command
        self._outbox.send_state(
            self._car.state,
            RoadSample(
                curvature_per_m=self._scenario.curvature_per_m,
                sample_time_ns=now_ns,
                command_echo=None if command is None else command.counter,
                is_watchdog_braking=self._watchdog.is_braking,
            ),
            now_ns,
            is_valid=not self.has_failed,
        )
        self._outbox.send_reference(
            self._scenario.path_ahead(self._s_m, self._state.vx_mps), now_ns
        )
        if self.driven_ticks > 0:
            self._outbox.send_feedback(self._applied, now_ns)
        if self._sent_ticks % MISSION_PERIOD_TICKS == 0:
            self._outbox.send_mission(
                Mission(
                    is_engaged=self._farewell_ticks == 0,
                    is_reset_requested=False,
                    mission_id=MISSION_ID,
                    valid_for_ns=MISSION_VALID_NS,
                ),
                now_ns,
            )
        if self._sent_ticks % IDENT_PERIOD_TICKS == 0:
            self._outbox.send_identity(None, now_ns)
        self._sent_ticks += 1
