"""Hydraulic brakes: pedal force to pressure to torque, with a rear circuit that yields early."""

from typing import NamedTuple

from sim_bridge.plant.jit import compiled
from sim_bridge.plant.parameters import BrakeParameters


class BrakeTorque(NamedTuple):
    """Largest friction torque of each wheel of an axle."""

    front_wheel_nm: float
    rear_wheel_nm: float


@compiled
def brake_torque(pressure_mpa: float, brakes: BrakeParameters) -> BrakeTorque:
    """Friction torques; above the knee the rear circuit follows only in part."""
    pressure = max(0.0, pressure_mpa)
    above = max(0.0, pressure - brakes.knee_mpa)
    rear_mpa = pressure - (1.0 - brakes.slope_above_knee) * above
    return BrakeTorque(brakes.front_nm_per_mpa * pressure, brakes.rear_nm_per_mpa * rear_mpa)


@compiled
def after_friction(speed: float, largest_change: float) -> float:
    """The speed that dry friction leaves: smaller by at most so much, and never reversed.

    A wheel stops and stays stopped as long as the other torques are too weak to turn it, whatever
    the step: lock-up needs neither a regularised sign function nor a small step.
    """
    if speed > largest_change:
        return speed - largest_change
    if speed < -largest_change:
        return speed + largest_change
    return 0.0
