"""From the curvature of a map to the values of a `CurvaturePreview`; for the sender of the path.

A car that follows a road turns by the integral of its curvature. So the five values are a fit along
the whole way, which keeps that integral. Where a road bends suddenly they oscillate around its
curvature; its values at the five places would instead move the bend by up to half a spacing.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import CurvaturePreview

KNOTS = len(CurvaturePreview._fields) - 1
INTERVALS = KNOTS - 1
LARGEST_PER_M = 0.16
"""range of the signals on the bus: a radius of 6.25 m"""
REACH_S = 1.1
"""time ahead for which the path and the curvature on the bus have to fit: the horizon of the
controller, and the delay before it"""
SHORTEST_SPACING_M, LONGEST_SPACING_M = 0.05, 65.5
"""ranges of the signals on the bus"""
_FIRST_LINE_FACTOR = 1.5
_TWO_SOURCES_PER_M = 5e-4
"""the curvatures of one place may differ so much if the vehicle measures one of them: over half a
second at 80 km/h that moves the road by 3 cm"""


def fit_preview(curvature_per_m: Array, reach_m: float) -> CurvaturePreview:
    """The preview of a road: a least-squares fit of its curvature.

    Straight lines between the five places, a circle and a clothoid among them, are exact.

    Args:
        curvature_per_m: (n,) at n equal distances from the car to `reach_m` ahead of it, both ends
            included; n is at least 5. With 33 a sudden bend is found to within 2 % of the reach.
        reach_m: 0.2 to 262; it should cover `REACH_S`.

    Raises:
        ValueError: fewer values, or values or a reach beyond the ranges of the bus.
    """
    values = np.asarray(curvature_per_m, dtype=np.float64)
    if values.ndim != 1 or len(values) < KNOTS:
        raise ValueError(
            f"curvature_per_m: expected at least {KNOTS} values at equal distances, found the "
            f"shape {values.shape}."
        )
    spacing_m = reach_m / INTERVALS
    require_range("curvature_per_m over reach_m", spacing_m, values.tolist())
    here = values[0]  # relative to it, so that a circle has exactly equal values
    knots = here + _fit(len(values)) @ (values - here)
    np.clip(knots, -LARGEST_PER_M, LARGEST_PER_M, out=knots)
    return CurvaturePreview(spacing_m, *knots.tolist())


def require_range(name: str, spacing_m: float, curvature_per_m: Sequence[float]) -> None:
    """Return if the signals on the bus can have these values; NaN is refused.

    Raises:
        ValueError: they cannot; `name` is that of the argument.
    """
    if not SHORTEST_SPACING_M <= spacing_m <= LONGEST_SPACING_M:
        raise ValueError(
            f"{name}: expected a spacing of {SHORTEST_SPACING_M:g} to {LONGEST_SPACING_M:g} m "
            f"between five values, found {spacing_m:g} m."
        )
    for value in curvature_per_m:
        require_curvature(name, value)


def require_curvature(name: str, curvature_per_m: float) -> None:
    """Return if the signals on the bus can have this curvature; NaN is refused.

    Raises:
        ValueError: they cannot; `name` is that of the argument.
    """
    if not abs(curvature_per_m) <= LARGEST_PER_M:
        raise ValueError(
            f"{name}: expected curvatures of at most {LARGEST_PER_M:g} 1/m, found "
            f"{curvature_per_m:g} 1/m."
        )


def is_plausible(preview: CurvaturePreview, curvature_per_m: float) -> bool:
    """True if the preview begins with the curvature that the state has at the same place.

    Two things may tell them apart, both in proportion to K1 - K0 where the road bends suddenly. The
    fit: with 33 samples K0 is off by up to 1.46 |K1 - K0|, when the bend is just ahead of the car.
    The age: in three periods a car travels half a spacing of 0.15 s and can enter a bend that is
    still ahead in the preview, which is then off by up to 0.9 |K1 - K0|.
    """
    bound_per_m = _FIRST_LINE_FACTOR * abs(preview.k1_per_m - preview.k0_per_m)
    return abs(preview.k0_per_m - curvature_per_m) <= bound_per_m + _TWO_SOURCES_PER_M


@lru_cache
def _fit(count: int) -> Array:
    """Map (5, count) from curvatures at equal distances to the five values."""
    place = np.linspace(0.0, INTERVALS, count)
    hats = np.stack([np.interp(place, range(KNOTS), row) for row in np.eye(KNOTS)], axis=1)
    return np.asarray(np.linalg.pinv(hats))
