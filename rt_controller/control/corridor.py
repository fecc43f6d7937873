"""Soft bounds on e_y: how far from the path the car may be before that costs extra."""

from typing import NamedTuple

import numpy as np

from rt_controller.contract.bundle import Array, Bundle
from rt_controller.control.objective import LATERAL, Situation
from rt_controller.control.prediction import free_response


class Corridor(NamedTuple):
    """A strip along the path, and how gladly the plan leaves it."""

    half_width_m: float
    beyond_m: float
    """how far beyond it costs as much as any other tolerated deviation"""

    @property
    def weight(self) -> float:
        """Of the squared slack."""
        return 1.0 / self.beyond_m**2


class CorridorRows:
    """-half <= e_y,k - e_y,r,k + s_k <= half for the stages of a horizon.

    The slacks s_k are free: one for each stage serves both sides, and costs nothing while the row
    itself holds.
    """

    def __init__(self, bundle: Bundle, horizon: int, corridor: Corridor) -> None:
        outputs = LATERAL + 1
        free = free_response(bundle, horizon, outputs)
        whole = np.column_stack([free.Phi, free.lam, free.mu])
        self._free_map = np.ascontiguousarray(whole[LATERAL::outputs])
        self._free_m = np.zeros(horizon)
        self._half_width_m = corridor.half_width_m

    def aim(self, situation: Situation, lower: Array, upper: Array) -> None:
        """Write the rows' bounds (N,) in metres of what the inputs add to e_y."""
        np.dot(self._free_map, situation.undriven, out=self._free_m)
        np.subtract(situation.reference[:, LATERAL], self._free_m, out=upper)
        np.subtract(upper, self._half_width_m, out=lower)
        upper += self._half_width_m
