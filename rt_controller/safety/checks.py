"""The table of plausibility checks: quantity, threshold, window, reaction.

How the thresholds were found, and what no check detects: `docs/safety.md`.
"""

from enum import Enum
from math import inf, nan
from typing import NamedTuple

from rt_controller.contract.car import DEFAULT_CAR, Car
from rt_controller.contract.faults import StopCause
from rt_controller.contract.quantities import Quantity
from rt_controller.contract.timing import PERIOD_S


class Reaction(Enum):
    """What follows when a quantity was above its threshold for the whole window."""

    REJECT_STATE = "the state is not used: the plan is held for two ticks, then the car is stopped"
    REJECT_PATH = "the path is not used: the plan is held for two ticks, then the car is stopped"
    STOP = "the car is stopped"
    REPORT = "a bit of the heartbeat; the drive goes on"
    REFUSE = "the controller does not begin to drive"


class Check(NamedTuple):
    """One row of the table."""

    name: str
    quantity: Quantity
    threshold: float
    window_ticks: int
    """ticks in a row above the threshold"""
    reaction: Reaction
    cause: StopCause
    """of the signal that is most often faulty; `isolation` may find another one"""


def _ticks(time_s: float) -> int:
    return round(time_s / PERIOD_S)


LARGEST_CURVATURE_STEP_PER_M = 2e-3
_FASTER_MPS2 = 0.5
"""lateral acceleration that a car needs besides, if it is 3 % faster than wanted"""
_Q, _R, _C = Quantity, Reaction, StopCause
_STATE, _PATH, _STOP = _R.REJECT_STATE, _R.REJECT_PATH, _R.STOP
_SHORT, _LONG = _ticks(0.075), _ticks(0.2)
_CURVATURE = LARGEST_CURVATURE_STEP_PER_M
_LATERAL = DEFAULT_CAR.path_lateral_mps2 + _FASTER_MPS2
CHECKS: tuple[Check, ...] = (
    Check("progress", _Q.PROGRESS_STEP_M, 0.02, 1, _STATE, _C.PROGRESS_IMPLAUSIBLE),
    Check("speed and progress", _Q.PROGRESS_SPEED_MPS, 0.5, 1, _STOP, _C.PROGRESS_IMPLAUSIBLE),
    Check("v_x, one step", _Q.SPEED_STEP_MPS, 0.7, 1, _STATE, _C.SPEED_IMPLAUSIBLE),
    Check("v_x, ten steps", _Q.SPEED_TEN_MPS, 2.0, _LONG, _STOP, _C.SPEED_IMPLAUSIBLE),
    Check(
        "v_y, one step", _Q.LATERAL_SPEED_STEP_MPS, 0.35, 1, _STATE, _C.LATERAL_SPEED_IMPLAUSIBLE
    ),
    Check(
        "v_y, ten steps", _Q.LATERAL_SPEED_TEN_MPS, 1.3, _LONG, _STOP, _C.LATERAL_SPEED_IMPLAUSIBLE
    ),
    Check("yaw rate, one step", _Q.YAW_RATE_STEP_RADPS, 0.08, 1, _STATE, _C.YAW_RATE_IMPLAUSIBLE),
    Check(
        "yaw rate, ten steps", _Q.YAW_RATE_TEN_RADPS, 0.35, _LONG, _STOP, _C.YAW_RATE_IMPLAUSIBLE
    ),
    Check("heading", _Q.HEADING_RAD, 0.016, 1, _STATE, _C.HEADING_IMPLAUSIBLE),
    Check("lateral error", _Q.LATERAL_ERROR_M, 0.3, 1, _STATE, _C.LATERAL_ERROR_IMPLAUSIBLE),
    Check(
        "curvature step", _Q.CURVATURE_STEP_PER_M, _CURVATURE, 1, _STATE, _C.CURVATURE_IMPLAUSIBLE
    ),
    Check("speed by pedals", _Q.PEDAL_SPEED_MPS, 1.5, 1, _STOP, _C.SPEED_IMPLAUSIBLE),
    Check("frozen state", _Q.FROZEN_TICKS, 7.5, 1, _STOP, _C.STATE_FROZEN),
    Check("steering feedback", _Q.STEERING_RAD, 0.03, _SHORT, _STOP, _C.STEERING_MISMATCH),
    Check("throttle feedback", _Q.THROTTLE, 0.08, _SHORT, _STOP, _C.THROTTLE_MISMATCH),
    Check("brake feedback", _Q.BRAKE_N, 10.0, _SHORT, _STOP, _C.BRAKE_MISMATCH),
    Check("tracking", _Q.TRACKING_M, 0.9, _LONG, _STOP, _C.TRACKING_LOST),
    Check("speed", _Q.SPEED_MPS, 2.0, _ticks(3.0), _R.REPORT, _C.SPEED_NOT_FOLLOWED),
    Check("training", _Q.OUTSIDE_TRAINING, 1.0, _ticks(0.1), _R.REPORT, _C.OUTSIDE_TRAINING),
    Check("path step", _Q.PATH_STEP_M, 0.55, 1, _PATH, _C.PATH_JUMP),
    Check("path drift", _Q.PATH_DRIFT_M, 0.25, 1, _STOP, _C.PATH_INCONSISTENT),
    Check("path frozen", _Q.PATH_FROZEN_M, 0.04, _SHORT, _STOP, _C.PATH_INCONSISTENT),
    Check("path turn", _Q.PATH_TURN_RAD, 0.03, 1, _PATH, _C.PATH_JUMP),
    Check("wanted speed", _Q.PATH_SPEED_STEP_MPS, 40.0, 1, _PATH, _C.PATH_SPEED_JUMP),
    Check("curvature ahead", _Q.PREVIEW_STEP_PER_M, _CURVATURE, 1, _PATH, _C.PREVIEW_JUMP),
    Check("path acceleration", _Q.PATH_LATERAL_MPS2, _LATERAL, 1, _PATH, _C.PATH_TOO_SHARP),
    Check("engagement, lateral", _Q.ENGAGE_EY_M, 1.0, 1, _R.REFUSE, _C.NOT_ENGAGED),
    Check("engagement, heading", _Q.ENGAGE_EPSI_RAD, 0.15, 1, _R.REFUSE, _C.NOT_ENGAGED),
)


def checks_of(car: Car) -> tuple[Check, ...]:
    """The table with the thresholds of this car."""
    brake_n = next(check.threshold for check in CHECKS if check.quantity is Quantity.BRAKE_N)
    chosen = {
        Quantity.PATH_LATERAL_MPS2: car.path_lateral_mps2 + _FASTER_MPS2,
        Quantity.BRAKE_N: min(car.force_scale, 1.0) * brake_n,
    }
    chosen.update((Quantity[name.upper()], value) for name, value in car.thresholds.items())
    return tuple(
        check._replace(threshold=chosen.get(check.quantity, check.threshold)) for check in CHECKS
    )


NEVER = inf
NOT_COMPUTED = nan
"""value of a quantity in a tick that has nothing to compute it from: above no threshold"""
