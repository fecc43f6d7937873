"""The path: the last one that was accepted, moved along with the car; checks of the next one."""

from collections import deque
from itertools import pairwise
from math import exp
from typing import NamedTuple

from rt_controller.contract.kinematics import lateral_change_m
from rt_controller.contract.limits import FAR, GRIP_AHEAD_S, NEAR
from rt_controller.contract.preview import is_plausible
from rt_controller.contract.quantities import Quantity
from rt_controller.contract.signals import CurvaturePreview, PathReference, VehicleState
from rt_controller.contract.timing import PERIOD_S


def lateral_demand(
    path: PathReference, curvature_per_m: float, preview: CurvaturePreview | None, speed_mps: float
) -> float:
    """Acceleration in m/s^2 that a car at `speed_mps` needs to follow the path.

    The larger one at two points of the next half second.
    """
    reach_m = GRIP_AHEAD_S * max(speed_mps, 0.0)
    near_per_m = far_per_m = curvature_per_m
    if preview is not None:
        near_per_m, far_per_m = (
            preview.curvature_at(share * reach_m / preview.spacing_m) for share in (NEAR, FAR)
        )
    bend, change = 2.0 * path.c2_per_m, 6.0 * path.c3_per_m2 * reach_m
    largest = max(abs(near_per_m + bend + NEAR * change), abs(far_per_m + bend + FAR * change))
    return largest * speed_mps**2


KNOWN_S = 0.5
"""time ahead for which a received path is used; beyond it the path turns parallel to the road"""
SHORTEST_M = 4.0
EASE_SHARE = 0.6
"""arc length in which the slope beyond the known part decays by a factor e, in units of that part:
a lane change goes on after its beginning, and does not go too far after its end"""
EASE_MPS2 = 4.0
"""lateral acceleration with which the path becomes parallel to the road, at most"""


class LastPath(NamedTuple):
    """A path as it was sent, and how far the car has moved since."""

    path: PathReference
    known_m: float
    """length of the part that is accepted"""
    moved_m: float = 0.0

    def moved(self, by_m: float) -> "LastPath":
        """The same path, the car `by_m` farther along the road."""
        return self._replace(moved_m=self.moved_m + by_m)

    def path_here(self) -> PathReference:
        """The path as a cubic from where the car is now."""
        c0, c1, c2, c3, v_mps, a_mps2 = self.path
        s = min(self.moved_m, self.known_m)
        here = c0 + s * (c1 + s * (c2 + s * c3))
        slope = c1 + s * (2.0 * c2 + 3.0 * s * c3)
        if self.moved_m <= self.known_m:
            return PathReference(here, slope, c2 + 3.0 * s * c3, c3, v_mps, a_mps2)
        speed_mps = self.known_m / KNOWN_S
        length_m = max(EASE_SHARE * self.known_m, abs(slope) * speed_mps**2 / EASE_MPS2)
        left = exp(-(self.moved_m - self.known_m) / length_m)
        here += slope * length_m * (1.0 - left)
        slope *= left
        return PathReference(
            here,
            slope,
            -slope / (2.0 * length_m),
            slope / (6.0 * length_m * length_m),
            v_mps,
            a_mps2,
        )


def known_length_m(vx_mps: float, path: PathReference) -> float:
    """Length of the part of a new path that is accepted."""
    return max(KNOWN_S * max(vx_mps, path.v_mps), SHORTEST_M)


SPEED_UP_MPS2, SLOW_DOWN_MPS2, CHANGE_MPS3 = 2.0, 3.0, 6.0
"""rates towards another wanted speed beside the accelerations that are sent, and their change"""
EASE_S, REACHED_MPS = 0.7, 0.02
"""time constant of the end of such a change, and when it is over"""
ASKED_TICKS = round(0.6 / PERIOD_S)
"""an acceleration may belong to a change of speed so far ahead, as before a stop"""
ALREADY_DRIVEN_MPS = 1.0
"""a drive begins with the wanted speed if the car is so close to it, else with that of the car"""
AHEAD_S = 0.5
"""about the horizon of the controller"""
RETURN_PER_S = 3.5
"""a path that is moved sideways by 0.5 m needs 1.4 m/s^2 and 21 m/s^3 besides, for 1.8 s"""
SLOWEST_MPS = 5.0
"""a slower car takes the same distance as at this speed"""
NEGLIGIBLE = 2e-4
"""m, m/s, m/s^2"""


class FollowedPath:
    """Distance and speed that are left from a path to the one that was followed before.

    The distance returns to zero as exp(-r t) (a + b t + c t^2): place, slope and curvature of the
    followed path change steadily, also if another request arrives meanwhile.
    """

    def __init__(self) -> None:
        self._asked_mps2: deque[float] = deque(maxlen=ASKED_TICKS)
        self.begin()

    def begin(self) -> None:
        """Restart without a path."""
        self._asked_mps2.clear()
        self._speed_mps = self._rate_mps2 = 0.0
        self._a_m = self._b_mps = self._c_mps2 = 0.0

    def shift(self, step_m: float, step_mps: float = 0.0) -> None:
        """The received path moved sideways against the car: what is followed does not.

        By `step_m` at once, and by `step_mps` from now on.
        """
        self._a_m -= step_m
        self._b_mps -= RETURN_PER_S * step_m + step_mps
        self._c_mps2 -= RETURN_PER_S * (0.5 * RETURN_PER_S * step_m + step_mps)

    def move(self, moved_m: float, speed_mps: float) -> None:
        """The car moved along the road."""
        t = moved_m / max(speed_mps, SLOWEST_MPS)
        left = exp(-RETURN_PER_S * t)
        self._a_m = left * (self._a_m + t * (self._b_mps + t * self._c_mps2))
        self._b_mps = left * (self._b_mps + 2.0 * t * self._c_mps2)
        self._c_mps2 *= left
        if abs(self._a_m) + abs(self._b_mps) + abs(self._c_mps2) < NEGLIGIBLE:
            self._a_m = self._b_mps = self._c_mps2 = 0.0

    def follow(self, path: PathReference, speed_mps: float, periods: int) -> PathReference:
        """What is to be followed by a car at `speed_mps`, instead of `path`."""
        self._approach(path, speed_mps, periods * PERIOD_S)
        if self._speed_mps != path.v_mps:
            a_mps2 = path.a_mps2 + self._rate_mps2
            path = path._replace(v_mps=self._speed_mps, a_mps2=a_mps2)
        return path if self._c_mps2 == 0.0 else self._beside(path, max(speed_mps, SLOWEST_MPS))

    def _approach(self, path: PathReference, speed_mps: float, time_s: float) -> None:
        """Move the followed speed towards the wanted one."""
        if not self._asked_mps2:
            is_driven = abs(path.v_mps - speed_mps) <= ALREADY_DRIVEN_MPS
            self._speed_mps = path.v_mps if is_driven else speed_mps
        self._asked_mps2.append(path.a_mps2)
        before, most = self._speed_mps, CHANGE_MPS3 * time_s
        left_mps = path.v_mps - before
        rate = min(max(left_mps / EASE_S, -SLOW_DOWN_MPS2), SPEED_UP_MPS2)
        rate = min(max(rate, min(self._rate_mps2, 0.0) - most), max(self._rate_mps2, 0.0) + most)
        lowest = before + time_s * (min(0.0, *self._asked_mps2) + min(rate, 0.0)) - REACHED_MPS
        highest = before + time_s * (max(0.0, *self._asked_mps2) + max(rate, 0.0)) + REACHED_MPS
        if lowest <= path.v_mps <= highest:
            self._speed_mps, self._rate_mps2 = path.v_mps, 0.0
        elif left_mps > 0.0:
            self._speed_mps, self._rate_mps2 = highest - REACHED_MPS, rate
        else:
            self._speed_mps, self._rate_mps2 = lowest + REACHED_MPS, rate

    def _beside(self, path: PathReference, speed_mps: float) -> PathReference:
        """The path with the distance that is left, as a cubic that fits its next half second."""
        here, slope = self._a_m, self._b_mps - RETURN_PER_S * self._a_m
        t, left = AHEAD_S, exp(-RETURN_PER_S * AHEAD_S)
        later = left * (self._a_m + t * (self._b_mps + t * self._c_mps2))
        later_slope = left * (self._b_mps + 2.0 * t * self._c_mps2) - RETURN_PER_S * later
        length_m = t * speed_mps
        c2 = (3.0 * (later - here) - t * (2.0 * slope + later_slope)) / length_m**2
        c3 = (2.0 * (here - later) + t * (slope + later_slope)) / length_m**3
        return path._replace(
            c0_m=path.c0_m + here,
            c1=path.c1 + slope / speed_mps,
            c2_per_m=path.c2_per_m + c2,
            c3_per_m2=path.c3_per_m2 + c3,
        )


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


MEMORY_S = 2.0
"""time constant with which the drift of the path decays"""
FASTEST_M = 0.12
"""of one tick in the drift; the check of one step finds a jump"""
BLENDED_M = 0.1
"""a larger step is a request; smaller ones are errors of measurement, and followed at once"""
MOST_BLENDED_M, MOST_BLENDED_MPS = 0.5, 1.0
"""step of an estimated place, and of its change"""
TURN_M = 10.0
"""distance ahead at which a turn of the path is measured as a lateral change"""
REMEMBERED_PATHS = 10
"""a drift is found after some time, so the stop follows the path of 250 ms ago"""


class PathChecks:
    """The last paths that were accepted, moved along with the car."""

    def __init__(self, values: list[float]) -> None:
        """`values` are filled in, by `Quantity`."""
        self._values = values
        self._accepted: deque[tuple[LastPath, float, float]] = deque(maxlen=REMEMBERED_PATHS)
        """with the distance that was travelled before, and the drift until then"""
        self._followed = FollowedPath()
        self.begin()

    def begin(self) -> None:
        """Forget all paths."""
        self.last: LastPath | None = None
        self._newest: PathReference | None = None
        self._drift_m = self._travelled_m = self._same_since_m = 0.0
        self._accepted.clear()
        self._followed.begin()

    def move(self, moved_m: float, speed_mps: float) -> None:
        """The car moved along the road by `moved_m`, at `speed_mps`."""
        self._travelled_m += moved_m
        self._followed.move(moved_m, speed_mps)
        if self.last is not None:
            self.last = self.last.moved(moved_m)

    def compare(
        self,
        path: PathReference,
        curvature_per_m: float,
        preview: CurvaturePreview | None,
        speed_mps: float,
    ) -> None:
        """Fill in the values of a path; one that was compared before has none.

        The first one has no path before it: only what it demands.
        """
        if path is self._newest:
            return
        values = self._values
        demand_mps2 = lateral_demand(path, curvature_per_m, preview, speed_mps)
        values[Quantity.PATH_LATERAL_MPS2] = demand_mps2
        frozen_m = self._frozen_m(path)
        if self.last is None:
            return
        before = self.last.path_here()
        step_m = path.c0_m - before.c0_m
        slow_m = min(max(step_m, -FASTEST_M), FASTEST_M)
        self._drift_m += slow_m - PERIOD_S / MEMORY_S * self._drift_m
        values[Quantity.PATH_STEP_M] = abs(step_m)
        values[Quantity.PATH_DRIFT_M] = abs(self._drift_m)
        values[Quantity.PATH_FROZEN_M] = frozen_m
        values[Quantity.PATH_TURN_RAD] = abs(path.c1 - before.c1)
        values[Quantity.PATH_SPEED_STEP_MPS] = max(path.v_mps - before.v_mps, 0.0)

    def _frozen_m(self, path: PathReference) -> float:
        """By how much a path that repeats itself should have changed while the car moved."""
        newest = self._newest
        if newest is None or newest[:4] != path[:4]:
            self._same_since_m = self._travelled_m
            return 0.0
        s = self._travelled_m - self._same_since_m
        _, c1, c2, c3 = path[:4]
        moved_m = s * (c1 + s * (c2 + s * c3))
        turned_rad = s * (2.0 * c2 + 3.0 * s * c3)
        return abs(moved_m) + TURN_M * abs(turned_rad)

    def accept(self, path: PathReference, speed_mps: float, keeps_speed: bool = False) -> None:
        """Store a path that may be followed, or its course alone, with the speed before."""
        if path is not self._newest:
            self._newest = path
            if keeps_speed and self.last is not None:
                before = self.last.path
                path = path._replace(v_mps=before.v_mps, a_mps2=before.a_mps2)
            if self.last is not None and self._values[Quantity.PATH_STEP_M] > BLENDED_M:
                self._followed.shift(path.c0_m - self.last.path_here().c0_m)
            self.last = LastPath(path, known_length_m(speed_mps, path))
            self._accepted.append((self.last, self._travelled_m, self._drift_m))

    def follow(self, path: PathReference, speed_mps: float, periods: int) -> PathReference:
        """What a car at `speed_mps` is to follow, after so many `periods`, instead of `path`."""
        return self._followed.follow(path, speed_mps, periods)

    def blend(self, before: VehicleState, state: VehicleState, periods: int) -> None:
        """An estimate replaces the state: approach the path from where the car seemed to be.

        A drift is found late. To correct all of it at once needs more grip than a wet road has.
        """
        change_m = lateral_change_m(before, before)
        step_m = state.ey_m - before.ey_m - periods * change_m
        step_mps = (lateral_change_m(state, state) - change_m) / PERIOD_S
        self._followed.shift(
            -min(max(step_m, -MOST_BLENDED_M), MOST_BLENDED_M),
            -min(max(step_mps, -MOST_BLENDED_MPS), MOST_BLENDED_MPS),
        )

    def reject(self) -> None:
        """Go on with the last path; if the paths drifted, with the oldest that is stored.

        The drift that it already had is subtracted.
        """
        if self._accepted and abs(self._drift_m) > abs(self._values[Quantity.PATH_STEP_M]):
            last, travelled_m, drift_m = self._accepted[0]
            path = last.path._replace(c0_m=last.path.c0_m - drift_m)
            self.last = last._replace(path=path, moved_m=self._travelled_m - travelled_m)
            self._accepted.clear()
        self._drift_m = 0.0
