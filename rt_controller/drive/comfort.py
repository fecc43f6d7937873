"""How calm a drive was: rate of the steering wheel, and jerk of the car."""

from math import nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array
from rt_controller.contract.timing import PERIOD_S
from rt_controller.drive.plan_view import plan_view
from rt_controller.drive.table import Drive

_AVERAGED = 4
"""periods over which an acceleration is averaged before its rate of change is taken"""


_LEAST_TICKS = _AVERAGED + 3
"""of which one value of the jerk is made"""


class Jerk(NamedTuple):
    """RMS of the rate of change of the acceleration over the ticks that drove, in m/s³.

    NaN where there is none.
    """

    along_mps3: float
    """in the direction of the car"""
    lateral_mps3: float


def wheel_rate_rms_degps(drive: Drive) -> float:
    """RMS of the rate of the steering wheel in the ticks that drove."""
    is_driven = _is_driven(drive)
    rates_radps = np.diff(drive["steer_rad"]) / np.diff(drive["time_s"])
    return float(np.degrees(_rms(rates_radps[is_driven[1:] & is_driven[:-1]])))


def jerk_of(drive: Drive) -> Jerk:
    """Jerk of the car, of a simulated one from its true place, averaged over 0.1 s."""
    if len(drive) < _LEAST_TICKS:
        return Jerk(nan, nan)
    x_m, y_m, yaw_rad = plan_view(drive).car
    acceleration = np.diff([x_m, y_m], n=2) / PERIOD_S**2
    cos, sin = np.cos(yaw_rad[1:-1]), np.sin(yaw_rad[1:-1])
    along = cos * acceleration[0] + sin * acceleration[1]
    lateral = cos * acceleration[1] - sin * acceleration[0]
    is_driven, window = _is_driven(drive), np.full(_AVERAGED, 1.0 / _AVERAGED)
    is_driven[np.argmax(is_driven)] = False  # the simulated car begins to move after it
    rms = []
    for each in (along, lateral):
        jerk = np.diff(np.convolve(each, window, "valid")) / PERIOD_S
        # its first and its last tick
        inside = is_driven[: len(jerk)] & is_driven[len(is_driven) - len(jerk) :]
        rms.append(_rms(jerk[inside]))
    return Jerk(*rms)


def _is_driven(drive: Drive) -> NDArray[np.bool_]:
    return np.array([mode.drives for mode in drive.modes])


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else nan
