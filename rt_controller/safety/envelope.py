"""The last check before a command is sent: finite, within bounds, slew-limited, one pedal."""

from math import isfinite

from rt_controller.contract.limits import (
    INPUT_LIMITS,
    RELEASED_BRAKE_N,
    RELEASED_THROTTLE,
    InputLimits,
)
from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_S


def limit(
    wanted: ControlInput, previous: ControlInput, limits: InputLimits = INPUT_LIMITS
) -> ControlInput:
    """The input nearest to `wanted` that may follow `previous` one period later.

    A wheel that is beyond its bound returns with its largest rate.

    A value that is not finite is replaced by the previous one. Rates hold in both directions, but
    a wanted throttle of 0 closes the throttle at once. If both pedals are wanted, the one that was
    pressed before must be released first; if neither was pressed, the brake has priority.
    """
    lower = limits.lower
    throttle, brake_n, steer_rad = map(_limit_one, wanted, previous, *limits)
    if wanted.throttle <= lower.throttle:
        throttle = lower.throttle
    throttle = 0.0 if throttle < RELEASED_THROTTLE else throttle
    brake_n = 0.0 if brake_n < RELEASED_BRAKE_N else brake_n
    if throttle > 0.0 and brake_n > 0.0:
        if previous.throttle > 0.0:
            brake_n = 0.0
        else:
            throttle = 0.0
    return ControlInput(throttle=throttle, brake_n=brake_n, steer_rad=steer_rad)


def _limit_one(wanted: float, previous: float, low: float, high: float, rate_per_s: float) -> float:
    if not isfinite(wanted):
        wanted = previous
    bounded = min(max(wanted, low), high)
    change = rate_per_s * PERIOD_S
    return min(max(bounded, previous - change), previous + change)
