"""Lateral acceleration that a path needs over the next half second."""

from rt_controller.contract.grip import AHEAD_S, FAR, NEAR
from rt_controller.contract.signals import CurvaturePreview, PathReference


def lateral_demand(
    path: PathReference,
    curvature_per_m: float,
    preview: CurvaturePreview | None,
    speed_mps: float,
) -> float:
    """Acceleration in m/s^2 that a car at `speed_mps` needs to follow the path.

    The larger one at two points of the next half second.
    """
    reach_m = AHEAD_S * max(speed_mps, 0.0)
    near_per_m = far_per_m = curvature_per_m
    if preview is not None:
        near_per_m, far_per_m = preview.k1_per_m, preview.k3_per_m
    bend, change = 2.0 * path.c2_per_m, 6.0 * path.c3_per_m2 * reach_m
    largest = max(
        abs(near_per_m + bend + NEAR * change),
        abs(far_per_m + bend + FAR * change),
    )
    return largest * speed_mps**2
