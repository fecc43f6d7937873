"""Comparison of the path with the paths before it, and its lateral acceleration."""

from collections import deque

from rt_controller.contract.kinematics import lateral_change_m
from rt_controller.contract.signals import CurvaturePreview, PathReference, VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.safety.checks import Quantity
from rt_controller.safety.path.followed_path import FollowedPath
from rt_controller.safety.path.last_path import LastPath, known_length_m
from rt_controller.safety.path.path_demand import lateral_demand

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
