"""The reference line ahead of the car: its curvature, and the stop at its end."""

from math import isfinite, isnan, sqrt

from rt_controller.contract.preview import REACH_S, fit_preview
from rt_controller.contract.signals import CurvaturePreview, PathReference
from rt_controller.contract.timing import PERIOD_S
from rt_controller.mapping.reference_line import ReferenceLine

PREVIEW_MIN_M, PREVIEW_VALUES = 4.0, 33
"""least reach, and resolution of the curvature ahead, as docs/connect.md recommends"""


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
