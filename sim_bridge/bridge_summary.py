"""Figures of a run of the bridge."""

from dataclasses import dataclass
from typing import NamedTuple

from rt_controller.gateway.braking_cause import BrakingCause
from sim_bridge.failed_actuators import Actuator


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
    def failed_text(self) -> str:
        """Which actuators have failed, for people; empty if none has."""
        return "; ".join(Actuator[name].value for name in self.failed_actuators)

    @property
    def braking_text(self) -> str:
        """Why the watchdog brakes, for people; empty if it does not."""
        if self.braking_cause is None:
            return ""
        cause = BrakingCause[self.braking_cause]
        if cause is BrakingCause.ACTUATOR_FAILED:
            return self.failed_text
        return "; ".join(filter(None, (cause.value, self.failed_text)))


class Truth(NamedTuple):
    """The true motion of the car, from the plant and not from the bus."""

    ey_error_m: float
    """from the wanted position"""
    speed_mps: float
    wanted_mps: float
    is_vehicle_braking: bool
    """the vehicle brakes by itself"""
    has_refused: bool
    """the vehicle does not follow the newest command"""
