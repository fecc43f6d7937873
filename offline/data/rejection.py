"""How many drawn drives were rejected, by the friction of the road."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from rt_controller.contract.arrays import Array

EDGES = (0.0, 0.4, 0.55, 0.7, 0.85, 2.0)
"""of the bands of friction"""


@dataclass(frozen=True, slots=True)
class FrictionBand:
    """The episodes whose lowest friction lies in one band."""

    friction: tuple[float, float]
    """lowest friction in these episodes, first value included"""
    episodes: int
    rejected: int
    """drawn before them, under the same conditions"""

    @property
    def rejected_fraction(self) -> float:
        """Share of the drawn drives that were rejected."""
        return self.rejected / max(1, self.rejected + self.episodes)


def by_friction(lowest_friction: Array, rejected: Array) -> tuple[FrictionBand, ...]:
    """The bands that contain episodes, from the slippery end.

    Args:
        lowest_friction: (E,) of each episode, on either side.
        rejected: (E,) number of rejected drives before each.
    """
    bands = []
    for low, high in pairwise(EDGES):
        is_inside = (lowest_friction >= low) & (lowest_friction < high)
        if np.any(is_inside):
            count = int(np.sum(is_inside))
            bands.append(FrictionBand((low, high), count, int(np.sum(rejected[is_inside]))))
    return tuple(bands)
