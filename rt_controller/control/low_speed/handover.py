"""Which law makes the input of a tick: the model, the low-speed law, or the brake at standstill."""

from math import inf
from typing import NamedTuple

from rt_controller.contract.signals import Mode, PathReference

AT_REST_MPS = 0.1
"""below this speed the car stands"""


class RestReference(NamedTuple):
    """Limits of the reference of a standing car."""

    v_mps: float
    """highest speed that is no start"""
    a_mps2: float
    """largest acceleration that is no start"""
    stop_m: float
    """longest distance to the next stop"""
    braking_mps2: float
    """least deceleration that is a stop, not a change of speed"""


ARRIVE = RestReference(v_mps=AT_REST_MPS, a_mps2=0.1, stop_m=0.15, braking_mps2=0.2)
"""a slow car comes to rest within these limits"""
STAY = RestReference(v_mps=0.2, a_mps2=0.2, stop_m=0.3, braking_mps2=0.1)
"""a standing car is held within these limits"""


class SpeedRange(NamedTuple):
    """Hysteresis between the model and the low-speed law."""

    leave_mps: float
    """below this speed the low-speed law takes over from the model"""
    resume_mps: float
    """above this speed the model takes over from the low-speed law"""


def stop_distance_m(path: PathReference) -> float:
    """Distance in which the reference speed falls to zero; inf if it does not fall.

    A path planner that sends v = sqrt(2 b d) and a = -b sends the distance d to the stop with it.
    """
    if path.a_mps2 >= 0.0:
        return inf
    return path.v_mps * path.v_mps / (-2.0 * path.a_mps2)


def wants_rest(path: PathReference, is_resting: bool) -> bool:
    """True if the reference is that of a standing car; `is_resting`: the last answer."""
    rest = STAY if is_resting else ARRIVE
    if path.a_mps2 > rest.a_mps2:
        return False
    is_stop = path.a_mps2 <= -rest.braking_mps2 and stop_distance_m(path) < rest.stop_m
    return is_stop or path.v_mps <= rest.v_mps


def next_law(
    law: Mode, vx_mps: float, path: PathReference, speeds: SpeedRange, is_turned: bool = False
) -> Mode:
    """The law of this tick after `law`: NOMINAL (the model), LOW_SPEED or STANDSTILL.

    The model does not take over a car whose wheel `is_turned` beyond the bound of its plans.

    Every threshold has a hysteresis, so noise of speed and reference does not change the law twice.
    """
    limit_mps = speeds.leave_mps if law is Mode.NOMINAL else speeds.resume_mps
    if vx_mps >= limit_mps and not (is_turned and law is not Mode.NOMINAL):
        return Mode.NOMINAL
    # A held car that rolls is for the brake too: the pedals of the law would release it.
    is_resting = law is Mode.STANDSTILL
    may_hold = is_resting or vx_mps < AT_REST_MPS
    return Mode.STANDSTILL if may_hold and wants_rest(path, is_resting) else Mode.LOW_SPEED
