"""The last known path, moved along with the car while no new one may be used."""

from math import exp
from typing import NamedTuple

from rt_controller.contract.signals import PathReference

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
