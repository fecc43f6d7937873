"""Comparison of the curvature ahead with the one before it; the last one that was accepted."""

from itertools import pairwise

from rt_controller.contract.preview import is_plausible
from rt_controller.contract.signals import CurvaturePreview
from rt_controller.safety.checks import Quantity

_INTERVALS = len(CurvaturePreview._fields) - 2
TOLERATED_CHANGES = 1.5
"""times the difference of two of the five values, since these are a fit of the road"""
RIPPLE = 0.25
"""of the fit farther from a sudden bend, per largest difference of two of the values"""


class LastRoad:
    """The last curvature ahead that was accepted, moved along with the car."""

    def __init__(self, values: list[float], largest_step_per_m: float) -> None:
        """`values` are filled in, by `Quantity`; a larger step is not accepted."""
        self._values = values
        self._largest_step_per_m = largest_step_per_m
        self.begin(None)

    def begin(self, preview: CurvaturePreview | None) -> None:
        """Restart at a road that is accepted."""
        self._preview = self._newest = preview
        self._moved_m = 0.0

    def move(self, by_m: float) -> None:
        """The car moved along the road."""
        self._moved_m += by_m

    def compare(self, curvature_per_m: float) -> None:
        """Fill in the step of the curvature at the car."""
        step_per_m = self._step_per_m(0.0, curvature_per_m)
        self._values[Quantity.CURVATURE_STEP_PER_M] = step_per_m

    def take(self, preview: CurvaturePreview | None, curvature_per_m: float | None) -> None:
        """Accept the curvature ahead if it continues the one before; fill in its step.

        One that contradicts the curvature at the car is not used by the controller: it has no step.
        """
        if preview is None or preview is self._newest:
            return
        self._newest = preview
        spacing_m = preview.spacing_m
        step_per_m = max(
            self._step_per_m(0.0, preview.k0_per_m),
            self._step_per_m(spacing_m, preview.k1_per_m),
            self._step_per_m(2.0 * spacing_m, preview.k2_per_m),
            self._step_per_m(3.0 * spacing_m, preview.k3_per_m),
        )
        agrees = curvature_per_m is None or is_plausible(preview, curvature_per_m)
        if agrees:
            self._values[Quantity.PREVIEW_STEP_PER_M] = step_per_m
        # Where no road is known nothing has a step.
        is_known = agrees or self._is_known_here()
        if step_per_m <= self._largest_step_per_m and is_known:
            self._preview, self._moved_m = preview, 0.0

    def curvature_here(self, otherwise_per_m: float) -> float:
        """Curvature of the road at the car; `otherwise_per_m` where none is known."""
        known = self._preview
        if known is None or not self._is_known_here():
            return otherwise_per_m
        return known.curvature_at(self._moved_m / known.spacing_m)

    def _is_known_here(self) -> bool:
        known = self._preview
        return known is not None and self._moved_m < _INTERVALS * known.spacing_m

    def ahead(self, preview: CurvaturePreview | None) -> CurvaturePreview | None:
        """The `preview` of this tick if it was accepted, else the last one that was."""
        known = self._preview
        if known is None or preview is known:
            return preview
        moved = self._moved_m / known.spacing_m
        knots = (known.curvature_at(moved + i) for i in range(_INTERVALS + 1))
        return CurvaturePreview(known.spacing_m, *knots)

    def _step_per_m(self, ahead_m: float, curvature_per_m: float) -> float:
        """Difference to the last road; a large one less the tolerated changes on both sides.

        0 where no road is known, as behind a car that has rolled back.
        """
        known = self._preview
        if known is None:
            return 0.0
        place = (self._moved_m + ahead_m) / known.spacing_m
        if not -1.0 < place < _INTERVALS:
            return 0.0
        knot = int(place)
        k0, k1 = known[1 + knot], known[2 + knot]
        step_per_m = abs(curvature_per_m - k0 - (place - knot) * (k1 - k0))
        if step_per_m <= self._largest_step_per_m:
            return step_per_m
        change_per_m = abs(k1 - k0)
        if knot > 0:
            change_per_m = max(change_per_m, abs(k0 - known[knot]))
        if knot + 1 < _INTERVALS:
            change_per_m = max(change_per_m, abs(known[3 + knot] - k1))
        roads = (known, self._newest or known)
        if step_per_m <= RIPPLE * max(map(_largest_change, roads)):
            return 0.0
        return max(step_per_m - TOLERATED_CHANGES * change_per_m, 0.0)


def _largest_change(preview: CurvaturePreview) -> float:
    return max(abs(after - before) for before, after in pairwise(preview[1:]))
