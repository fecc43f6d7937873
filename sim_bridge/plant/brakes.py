"""Hydraulic brakes: pedal force to pressure to torque, with a pressure limit for the rear axle."""

from sim_bridge.plant.drive.drive_parts import AntiLockParameters, BrakeParameters
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
def release_per_s(
    forward_mps: float, rim_mps: float, release: float, anti_lock: AntiLockParameters
) -> float:
    """Rate of the released share of a wheel's pressure: it controls the slip of the wheel.

    Args:
        forward_mps: speed of the wheel's centre.
        rim_mps: spin times rolling radius.
        release: share released now.
    """
    if anti_lock.slip == 0.0:
        return 0.0
    speed_mps = abs(forward_mps)
    if speed_mps < anti_lock.least_speed_mps:
        return -anti_lock.apply_per_s if release > 0.0 else 0.0
    excess = 1.0 - abs(rim_mps) / speed_mps - anti_lock.slip
    wanted = min(1.0, max(-1.0, excess / anti_lock.slip_band))
    if wanted > 0.0:
        return wanted * anti_lock.release_per_s if release < 1.0 else 0.0
    return wanted * anti_lock.apply_per_s if release > 0.0 else 0.0


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
