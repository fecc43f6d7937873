"""`BridgeSummary`: what a run of the bridge came to, as figures, as texts, and as an error."""

from dataclasses import dataclass

from rt_controller.contract.errors import BusError, PlantError
from rt_controller.contract.timing import PERIOD_MS
from rt_controller.vehicle.braking_cause import BrakingCause
from rt_controller.vehicle.vehicle_envelope import FARTHEST_DRIVEN_M, FARTHEST_OFF_PATH_M
from sim_bridge.car_guard import Actuator
from sim_bridge.scenario_run import AT_REST_MPS


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
    refused_ticks: dict[str, int]
    """ticks in which the newest command was refused, by name of the reason"""
    foreign_frames: int
    """frames that only this vehicle sends"""
    frames_received: dict[str, int]
    """damaged, repeated and missing ones, by kind"""
    plant_failure: str | None
    """why the motion is not finite or too fast; the figures are those before it"""
    braking_cause: str | None = None
    """name of the `BrakingCause` with which the watchdog began to brake; None: it did not brake"""
    failed_actuators: tuple[str, ...] = ()
    """names of each `Actuator` that has failed, in the order of detection"""
    released: bool = False
    """the controller released the car after the end of the mission: a driver has taken it"""

    @property
    def braking_text(self) -> str:
        """Why the watchdog brakes, for people; empty if it does not."""
        if self.braking_cause is None:
            return ""
        cause = BrakingCause[self.braking_cause]
        why = [] if cause is BrakingCause.ACTUATOR_FAILED else [cause.value]
        return "; ".join((*why, *(Actuator[name].value for name in self.failed_actuators)))

    @property
    def refused_text(self) -> str:
        """Which commands were refused, and how often; empty if none were."""
        listed = ", ".join(f"{ticks} {name}" for name, ticks in self.refused_ticks.items())
        return f"ticks with refused commands: {listed}" if listed else ""

    @property
    def figures_text(self) -> str:
        """Length of the drive, speed and lateral error."""
        return (
            f"{self.ticks:5d} ticks  {self.travelled_m:6.1f} m  "
            f"{self.final_speed_mps * 3.6:5.1f} km/h  lateral error RMS {self.ey_rms_m:.3f} m, "
            f"peak {self.ey_peak_m:.3f} m"
        )

    def text(self, is_stopped: bool) -> str:
        """The run in one line; `is_stopped`: it was requested to end."""
        if self.ticks == 0:
            return "ended before a controller took the car: nothing was driven"
        braked = f"BRAKED BY THE WATCHDOG: {self.braking_text}"
        if self.controller_ended:
            braked = "the controller ended its drive with a safe stop"
        is_released = self.released and self.final_speed_mps > AT_REST_MPS
        parts = (
            self.figures_text,
            self.refused_text,
            self.watchdog_braked and braked,
            self.plant_failure and "THE PLANT FAILED",
            is_stopped and "stopped on request before the end",
            is_released and f"released at {self.final_speed_mps * 3.6:.0f} km/h",
        )
        return "  ".join(part for part in parts if part)

    def require_success(self) -> None:
        """Return if neither the plant failed nor the watchdog braked the driven car.

        Raises:
            PlantError: the plant failed.
            BusError: the watchdog braked the car while the controller drove it.
        """
        if self.plant_failure is not None:
            raise PlantError(
                f"Expected a plant that drives to the end, found a failure of "
                f"{self.plant_failure}. Invalid states were sent from there on; the figures end "
                f"before it."
            )
        if not self.watchdog_braked or self.controller_ended:
            return
        found = f"that {self.braking_text}"
        match BrakingCause[self.braking_cause or "NO_COMMAND"]:
            case BrakingCause.ACTUATOR_FAILED:
                expected = "actuators that follow their commands"
                remedy = "Check them, or the faults of this drive"
            case BrakingCause.LEAVING_PATH:
                expected = (
                    f"a car that stays within {FARTHEST_DRIVEN_M:g} m of its path "
                    f"({FARTHEST_OFF_PATH_M:g} m in a safe stop)"
                )
                remedy = (
                    "Check the controller and its model, the scenario, or the faults of this drive"
                )
            case _:
                expected, found = f"a command every {PERIOD_MS:g} ms", self.braking_text
                refused = self.refused_text
                remedy = f"There were {refused}" if refused else "The controller stopped sending"
        raise BusError(
            f"Expected {expected}, found {found}. {remedy}. The car was braked to "
            f"{self.final_speed_mps:.1f} m/s."
        )
