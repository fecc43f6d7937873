"""What is sent when the plan may not drive: standing by, and the safe stop."""

from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_S

SAFE_STOP_BRAKE_N = 75.0
"""about 0.4 g on a dry road: firm, and within grip while the wheel is still turned"""
SAFE_STOP_BRAKE_RATE_N_PER_S = 150.0
STEER_EASE_RADPS = 0.7
"""40 deg/s of wheel angle towards the middle"""


def stand_by(previous: ControlInput) -> ControlInput:
    """Pedals released, the wheel eased to the middle."""
    return ControlInput(throttle=0.0, brake_n=0.0, steer_rad=_ease(previous.steer_rad))


def safe_stop(previous: ControlInput, planned_steer_rad: float | None) -> ControlInput:
    """One period of the safe stop: throttle closed at once, brake ramped, wheel along the path.

    The wheel follows what is left of the last good plan (`planned_steer_rad`), since a hand that
    freezes in the middle of a lane change leaves the road; after that it eases to the middle.
    """
    brake_n = min(
        max(previous.brake_n, 0.0) + SAFE_STOP_BRAKE_RATE_N_PER_S * PERIOD_S, SAFE_STOP_BRAKE_N
    )
    steer_rad = _ease(previous.steer_rad) if planned_steer_rad is None else planned_steer_rad
    return ControlInput(throttle=0.0, brake_n=brake_n, steer_rad=steer_rad)


def _ease(steer_rad: float) -> float:
    change = STEER_EASE_RADPS * PERIOD_S
    return steer_rad - min(max(steer_rad, -change), change)
