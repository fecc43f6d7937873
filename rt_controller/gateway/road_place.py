"""The place of the car on its road, at the present: from its pose and a line, or from its own e_y.

A measurement is moved on by the motion since then, so that a slow or delayed signal gives a place
in every period.
"""

from math import cos, isfinite, isnan, nan, remainder, sin, sqrt, tau
from typing import NamedTuple

import numpy as np

from rt_controller.contract.kinematics import progress_m
from rt_controller.contract.preview import REACH_S, fit_preview
from rt_controller.contract.signals import CurvaturePreview, PathReference, VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.gateway.samples import Motion, MotionHistory, Sample, Samples
from rt_controller.mapping.reference_line import ReferenceLine

PREVIEW_MIN_M, PREVIEW_VALUES = 4.0, 33
"""least reach, and resolution of the curvature ahead, as docs/connect.md recommends"""
LARGEST_JUMP_M = 3.0
"""of the arc length in one period beyond the motion: more is a pose that jumped"""


class RoadPlace(NamedTuple):
    """Where the car is at the present; NaN: not known."""

    s_m: float
    """along the reference line; NaN without one"""
    ds_m: float
    """progress in the last period"""
    ey_m: float
    epsi_rad: float
    curvature_per_m: float


class PlaceOnLine:
    """By [pose] and its reference line."""

    def __init__(
        self, line: ReferenceLine, farthest_m: float, ahead_m: float = 0.0, left_m: float = 0.0
    ) -> None:
        self._line = line
        self._farthest_m = farthest_m
        self._ahead_m, self._left_m = ahead_m, left_m
        self._last_s_m = nan

    def locate(self, samples: Samples, history: MotionHistory, motion: Motion) -> RoadPlace | None:
        """The place; None: a pose is missing."""
        now_ns = motion.time_ns
        x, y, yaw = (samples.newest(f"pose.{name}", now_ns) for name in ("x", "y", "yaw"))
        if x is None or y is None or yaw is None:
            return None
        yaw_rad = yaw.value + history.turned(yaw.measured_ns)
        x_m = x.value + history.moved(x.measured_ns, yaw_rad)[0]
        y_m = y.value + history.moved(y.measured_ns, yaw_rad)[1]
        x_m += self._left_m * sin(yaw_rad) - self._ahead_m * cos(yaw_rad)
        y_m -= self._left_m * cos(yaw_rad) + self._ahead_m * sin(yaw_rad)
        if not all(map(isfinite, (x_m, y_m, yaw_rad))):
            return RoadPlace(nan, nan, nan, nan, nan)
        at = self._line.locate(np.array([[x_m, y_m, yaw_rad]]))
        s_m, ey_m, epsi_rad, curvature = (float(each[0]) for each in at)
        ds_m = _progress_m(motion, ey_m, epsi_rad, curvature)
        moved_m = float(self._line.progress(np.array([self._last_s_m, s_m]))[0])
        has_jumped = abs(moved_m - ds_m) > LARGEST_JUMP_M
        self._last_s_m = s_m
        if has_jumped or abs(ey_m) > self._farthest_m:
            ey_m = epsi_rad = nan
        return RoadPlace(s_m, ds_m, ey_m, epsi_rad, curvature)


class PlaceMeasured:
    """By the states ey_m and epsi_rad and the curvature that the car sends."""

    def locate(self, samples: Samples, history: MotionHistory, motion: Motion) -> RoadPlace | None:
        """The place; None: one of the signals is missing."""
        names = ("states.ey_m", "states.epsi_rad", "exogenous.curvature_per_m")
        ey, epsi, curvature = (samples.newest(name, motion.time_ns) for name in names)
        if ey is None or epsi is None or curvature is None:
            return None
        kappa = curvature.value
        epsi_rad = epsi.value + history.turned(epsi.measured_ns)
        epsi_rad = remainder(epsi_rad - kappa * _driven(motion, epsi), tau)
        ey_m = ey.value + history.moved(ey.measured_ns, epsi_rad)[1]
        return RoadPlace(nan, _progress_m(motion, ey_m, epsi_rad, kappa), ey_m, epsi_rad, kappa)


def _progress_m(motion: Motion, ey_m: float, epsi_rad: float, curvature_per_m: float) -> float:
    """Arc length driven in one period of steady motion."""
    _, vx_mps, vy_mps, yaw_rate = motion
    state = VehicleState(vx_mps, vy_mps, yaw_rate, 0.0, ey_m, epsi_rad)
    return progress_m(state, state, curvature_per_m)


def _driven(motion: Motion, since: Sample) -> float:
    return motion.vx_mps * 1e-9 * (motion.time_ns - since.measured_ns)


def preview_on(
    line: ReferenceLine | None, s_m: float, vx_mps: float, wanted_mps: float
) -> CurvaturePreview | None:
    """The curvature ahead of s; None: no line, no place on it, or beyond the range of the bus."""
    if line is None or not isfinite(s_m + vx_mps + wanted_mps):
        return None
    reach_m = max(REACH_S * max(vx_mps, wanted_mps), PREVIEW_MIN_M)
    ahead = line.curvature_ahead(s_m, reach_m, PREVIEW_VALUES)
    try:
        return fit_preview(ahead, reach_m)
    except ValueError:  # beyond the range of the bus: the controller takes the curvature here
        return None


def stop_at_end(
    line: ReferenceLine, path: PathReference, s_m: float, vx_mps: float, stop_mps2: float
) -> PathReference:
    """The path, with the speed and deceleration that end at the end of an open line."""
    if line.is_closed or isnan(s_m):
        return path
    left_m = max(line.length_m - s_m - max(vx_mps, 0.0) * PERIOD_S, 0.0)
    stopping_mps = sqrt(2.0 * stop_mps2 * left_m)
    if stopping_mps >= path.v_mps:
        return path
    return path._replace(v_mps=stopping_mps, a_mps2=-stop_mps2 if left_m > 0.0 else 0.0)
