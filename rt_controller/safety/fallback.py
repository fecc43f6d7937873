"""The input of each mode: the plan, or what is sent when no plan may be followed."""

from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.contract.timing import PERIOD_S

SAFE_STOP_BRAKE_N = 75.0
"""about 0.4 g on a dry road: within the grip of the tyres while the wheel is still turned"""
SAFE_STOP_BRAKE_RATE_N_PER_S = 150.0
STEER_RETURN_RADPS = 0.7
"""40 deg/s of steering-wheel angle towards zero"""


def input_for(
    mode: Mode, planned: ControlInput | None, previous: ControlInput, is_held: bool
) -> ControlInput:
    """The input that `mode` wants.

    Args:
        mode: of this tick.
        planned: that of the last good plan, if it has one.
        previous: input of the last period.
        is_held: True if the brake holds a standing car, by the last law that was chosen.
    """
    if mode is Mode.STANDBY:
        return stand_by(previous)
    if mode is Mode.SAFE_STOP or planned is None:
        return safe_stop(previous, planned, is_held)
    return planned


def stand_by(previous: ControlInput) -> ControlInput:
    """Input of one period of standby: pedals released, steering returning to zero."""
    return ControlInput(throttle=0.0, brake_n=0.0, steer_rad=_towards_zero(previous.steer_rad))


def safe_stop(previous: ControlInput, planned: ControlInput | None, is_held: bool) -> ControlInput:
    """Input of one period of the safe stop: throttle closed, brake ramped, steering on the path.

    The steering follows the last good plan: a constant wheel angle in the middle of a lane change
    would leave the road. Without a plan it returns to zero. The brake of a car that is held may be
    pressed further than that of a stopping car, and is not released.
    """
    brake_n = min(
        max(previous.brake_n, 0.0) + SAFE_STOP_BRAKE_RATE_N_PER_S * PERIOD_S, SAFE_STOP_BRAKE_N
    )
    if is_held:
        brake_n = max(brake_n, previous.brake_n, 0.0 if planned is None else planned.brake_n)
    steer_rad = _towards_zero(previous.steer_rad) if planned is None else planned.steer_rad
    return ControlInput(throttle=0.0, brake_n=brake_n, steer_rad=steer_rad)


def _towards_zero(steer_rad: float) -> float:
    change = STEER_RETURN_RADPS * PERIOD_S
    return steer_rad - min(max(steer_rad, -change), change)
