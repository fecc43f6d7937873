"""The last word before the frames: finite, in the box, slew-limited, one pedal at a time."""

from math import isfinite

from rt_controller.contract.limits import InputLimits
from rt_controller.contract.signals import ControlInput

PEDAL_RELEASED_THROTTLE = 1e-3
PEDAL_RELEASED_BRAKE_N = 0.15
"""below these a pedal counts as untouched: a thousandth of its travel"""


def confine(
    wanted: ControlInput, previous: ControlInput, limits: InputLimits, dt_s: float
) -> ControlInput:
    """The input nearest to `wanted` that may follow `previous` one period later.

    An entry that is not finite becomes the previous one. Rates hold in both directions, but a
    throttle that shall close closes at once. Of two pressed pedals the one that was pressed before
    has to come up first; if neither was, the brake wins.
    """
    low, high, rate = limits.lower, limits.upper, limits.rate_per_s
    throttle = _confine_one(wanted[0], previous[0], low[0], high[0], rate[0] * dt_s)
    brake_n = _confine_one(wanted[1], previous[1], low[1], high[1], rate[1] * dt_s)
    steer_rad = _confine_one(wanted[2], previous[2], low[2], high[2], rate[2] * dt_s)
    if wanted.throttle <= limits.lower.throttle:
        throttle = limits.lower.throttle
    throttle = 0.0 if throttle < PEDAL_RELEASED_THROTTLE else throttle
    brake_n = 0.0 if brake_n < PEDAL_RELEASED_BRAKE_N else brake_n
    if throttle > 0.0 and brake_n > 0.0:
        if previous.throttle > 0.0:
            brake_n = 0.0
        else:
            throttle = 0.0
    return ControlInput(throttle=throttle, brake_n=brake_n, steer_rad=steer_rad)


def _confine_one(wanted: float, previous: float, low: float, high: float, change: float) -> float:
    if not isfinite(wanted):
        wanted = previous
    slewed = min(max(wanted, previous - change), previous + change)
    return min(max(slewed, low), high)
