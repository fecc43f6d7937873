"""Hydraulic brakes: pedal force to pressure to torque, with a pressure limit for the rear axle."""

from sim_bridge.plant.car_parts import BrakeParameters
from sim_bridge.plant.jit import compiled


@compiled
def steady_pressures_mpa(pedal_n: float, brakes: BrakeParameters) -> tuple[float, float]:
    """Steady pressures of the front and the rear circuit under a constant pedal force.

    Above the knee the rear one rises with a smaller slope.
    """
    front_mpa = brakes.pedal_mpa_per_n * max(0.0, pedal_n)
    above = max(0.0, front_mpa - brakes.knee_mpa)
    return front_mpa, front_mpa - (1.0 - brakes.slope_above_knee) * above


@compiled
def after_friction(speed: float, largest_change: float) -> float:
    """The speed after dry friction: smaller by at most `largest_change`, never reversed.

    A stopped wheel stays stopped while the other torques are weaker than the friction, for any step
    size: a locked wheel needs neither a regularised sign function nor a small step.
    """
    if speed > largest_change:
        return speed - largest_change
    if speed < -largest_change:
        return speed + largest_change
    return 0.0
