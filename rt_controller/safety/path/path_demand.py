"""Lateral acceleration and jerk that a path needs over the next half second."""

from rt_controller.contract.signals import CurvaturePreview, PathReference

AHEAD_S = 0.5
"""about the horizon of the controller"""


def lateral_demand(
    path: PathReference,
    curvature_per_m: float,
    preview: CurvaturePreview | None,
    speed_mps: float,
) -> tuple[float, float]:
    """(m/s^2, m/s^3) that a car at `speed_mps` needs to follow the path.

    The acceleration is the largest one at the car, half the way and at the end of the next half
    second; the jerk is that of the path against the road.
    """
    reach_m = AHEAD_S * max(speed_mps, 0.0)
    curvatures = (curvature_per_m, curvature_per_m, curvature_per_m)
    if preview is not None:
        curvatures = (curvature_per_m, preview.k2_per_m, preview.k4_per_m)
    bend = 2.0 * path.c2_per_m
    change = 6.0 * path.c3_per_m2
    largest = max(
        abs(curvatures[0] + bend),
        abs(curvatures[1] + bend + change * 0.5 * reach_m),
        abs(curvatures[2] + bend + change * reach_m),
    )
    return largest * speed_mps**2, abs(change * speed_mps**3)
