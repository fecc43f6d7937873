"""The drives of the matrix: what a car does while a fault acts, at any speed."""

from collections.abc import Callable
from typing import Any

LANE_CHANGE = "lane_change"
WIDTH_M = 3.5
CHANGE_AT_S, CHANGE_S, RETURN_AT_S = 1.0, 2.5, 4.5
DURATION_S = 6.0
"""a stop that has begun before goes on until the car stands"""
GENTLE_BEND_PER_M = 0.001
BEND_MPS2, SHARPEST_BEND_PER_M = 4.0, 0.009
BEND_AT_S, BENT_AT_S = 1.0, 2.5
LIMIT_CHANGE_S, WET_CHANGE_S = 2.1, 3.0
WET_FRICTION = 0.5
S_BEND_FRICTION = 0.85
S_BEND_MPS2_PER_FRICTION = 5.0
S_BEND_KNOTS_S = (1.0, 2.0, 4.5, 6.5, 9.0, 10.0)
BRAKE_AT_S, BRAKE_S, HOLD_S = 1.0, 5.0, 3.0

Content = dict[str, Any]
"""of a scenario file, without what all drives have"""


def manoeuvre(name: str, speed_mps: float) -> Content:
    """Road, path, stops and duration of one of `MANOEUVRES`."""
    return {"duration_s": DURATION_S} | MANOEUVRES[name](speed_mps)


def _lane_change(speed_mps: float, change_s: float = CHANGE_S) -> Content:
    """To the left and back, in a bend of 1000 m."""
    moves = [
        {"start_m": at_s * speed_mps, "length_m": change_s * speed_mps, "to_m": to_m}
        for at_s, to_m in ((CHANGE_AT_S, WIDTH_M), (RETURN_AT_S, 0.0))
    ]
    return {
        "road": {"curvature_per_m": GENTLE_BEND_PER_M},
        "ey_m": {"kind": "moves", "moves": moves},
    }


def _near_the_limit(speed_mps: float) -> Content:
    """The same in 2.1 s: 5 to 5.7 m/s²."""
    return _lane_change(speed_mps, LIMIT_CHANGE_S)


def _wet_lane_change(speed_mps: float) -> Content:
    """The same in 3 s on a road of the friction 0.5."""
    content = _lane_change(speed_mps, WET_CHANGE_S)
    return content | {"road": content["road"] | {"friction": WET_FRICTION}}


def _straight(speed_mps: float) -> Content:
    """Steady driving on a straight road."""
    return {}


def _bend(speed_mps: float) -> Content:
    """Through a clothoid into a bend of 4 m/s², or of the smallest radius of the wheel."""
    bend_per_m = min(BEND_MPS2 / speed_mps**2, SHARPEST_BEND_PER_M)
    knots = [at_s * speed_mps for at_s in (BEND_AT_S, BENT_AT_S)]
    return {"road": {"curvature_per_m": {"s_m": knots, "value": [0.0, bend_per_m]}}}


def _s_bend(speed_mps: float, friction: float = S_BEND_FRICTION) -> Content:
    """To the left and to the right, with half of the grip: 4.3 m/s² at the friction 0.85."""
    demand_mps2 = S_BEND_MPS2_PER_FRICTION * friction
    bend_per_m = min(demand_mps2 / speed_mps**2, SHARPEST_BEND_PER_M)
    bends = [bend_per_m * turn for turn in (0.0, 1.0, 1.0, -1.0, -1.0, 0.0)]
    knots = [at_s * speed_mps for at_s in S_BEND_KNOTS_S]
    road = {"curvature_per_m": {"s_m": knots, "value": bends}, "friction": friction}
    return {"road": road, "duration_s": 12.0}


def _wet_s_bend(speed_mps: float) -> Content:
    """The same with 2.5 m/s² on a road of the friction 0.5."""
    return _s_bend(speed_mps, WET_FRICTION)


def _slalom(speed_mps: float) -> Content:
    """A sine of 0.6 m at 0.4 Hz on a straight road."""
    return {"ey_m": {"kind": "sine", "amplitude_m": 0.6, "frequency_hz": 0.4}}


def _stop_and_hold(speed_mps: float) -> Content:
    """Brake from 1 to 6 s, hold for 3 s, drive on."""
    braking_m = 0.5 * speed_mps * BRAKE_S
    stop = {
        "at_s_m": BRAKE_AT_S * speed_mps + braking_m,
        "hold_s": HOLD_S,
        "deceleration_mps2": speed_mps / BRAKE_S,
    }
    return {"stops": [stop], "duration_s": 12.0}


MANOEUVRES: dict[str, Callable[[float], Content]] = {
    LANE_CHANGE: _lane_change,
    "near_the_limit": _near_the_limit,
    "wet_lane_change": _wet_lane_change,
    "straight": _straight,
    "bend": _bend,
    "s_bend": _s_bend,
    "wet_s_bend": _wet_s_bend,
    "slalom": _slalom,
    "stop_and_hold": _stop_and_hold,
}
