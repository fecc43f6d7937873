"""The speed that the bends of a road allow."""

from typing import NamedTuple

import numpy as np

from sim_bridge.scenario.speed import SpeedProfile, speed_over_distance
from sim_bridge.scenario.table import Table

_GRID_M = 1.0


class Comfort(NamedTuple):
    """Largest accelerations that are asked for."""

    lateral_mps2: float = 3.0
    acceleration_mps2: float = 1.5
    deceleration_mps2: float = 2.5


def curve_speed(
    curvature: Table,
    fastest_mps: Table,
    end_m: float,
    comfort: Comfort,
    start_m: float = 0.0,
    first_mps: float | None = None,
) -> SpeedProfile:
    """The fastest speed within its limits: first by curvature, then backwards, then forwards.

    Args:
        curvature: of the road in 1/m.
        fastest_mps: speed limit along the road.
        end_m: arc length up to which it is computed.
        comfort: accelerations.
        start_m: arc length from which it is computed.
        first_mps: speed at `start_m`; None: as fast as allowed.
    """
    s_m = np.arange(start_m, end_m + _GRID_M, _GRID_M)
    around = np.maximum.reduce([np.abs(curvature(s_m + shift)) for shift in (-_GRID_M, 0, _GRID_M)])
    squared = np.minimum(fastest_mps(s_m) ** 2, comfort.lateral_mps2 / np.maximum(around, 1e-9))
    gain = 2.0 * _GRID_M * comfort.acceleration_mps2
    loss = 2.0 * _GRID_M * comfort.deceleration_mps2
    for i in range(len(s_m) - 2, -1, -1):
        squared[i] = min(squared[i], squared[i + 1] + loss)
    if first_mps is not None:
        squared[0] = first_mps**2
    for i in range(1, len(s_m)):
        squared[i] = min(squared[i], squared[i - 1] + gain)
        if first_mps is not None:  # a car that is too fast at first can only brake
            squared[i] = max(squared[i], squared[i - 1] - loss)
    return speed_over_distance(s_m.tolist(), np.sqrt(squared).tolist())
