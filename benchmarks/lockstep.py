"""A closed-loop drive in simulated time on a virtual bus."""

from rt_controller.config import ControllerConfig
from rt_controller.control.mpc import Mpc
from rt_controller.drive.table import TrackingErrors
from rt_controller.model.bundle import Bundle
from rt_controller.node import plan_at_constant_speed
from rt_controller.settings import CarSettings
from rt_controller.simulation import drive_in_lockstep


def drive_scenario(bundle: Bundle, mpc: Mpc, scenario: str) -> TrackingErrors:
    """Tracking errors of a whole scenario, driven with `mpc`."""
    plan_at_constant_speed(mpc)
    return drive_in_lockstep(ControllerConfig(), bundle, mpc, CarSettings(scenario=scenario)).errors
