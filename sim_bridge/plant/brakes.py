"""Hydraulic brakes: pedal force to pressure to torque, with a rear circuit that yields early."""

from sim_bridge.plant.car_parts import BrakeParameters
from sim_bridge.plant.jit import compiled


@compiled
def front_pressure_mpa(pedal_n: float, brakes: BrakeParameters) -> float:
    """Pressure that the front circuit tends to under a held pedal."""
    return brakes.pedal_mpa_per_n * max(0.0, pedal_n)


@compiled
def rear_pressure_mpa(front_mpa: float, brakes: BrakeParameters) -> float:
    """Pressure that the rear circuit tends to: above the knee it follows only in part."""
    above = max(0.0, front_mpa - brakes.knee_mpa)
    return front_mpa - (1.0 - brakes.slope_above_knee) * above


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
