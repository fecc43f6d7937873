"""`Road`: what the ground of a scenario is like, as tables over the arc length s."""

from dataclasses import dataclass, field
from math import atan, inf

import numpy as np

from rt_controller.contract.arrays import Array
from sim_bridge.frenet import CurvatureTable
from sim_bridge.plant.protocol import RoadAt
from sim_bridge.scenario.table import Table, constant

CURVATURE_KNOTS = 5
"""values that `curvature_ahead` returns unless told otherwise"""


@dataclass(frozen=True, slots=True, eq=False)
class Road:
    """A reference line and the ground along it."""

    curvature_per_m: Table
    """positive to the left"""
    friction_left: Table
    """under the left wheels; 1 is the road of the tyre test"""
    friction_right: Table
    bank_rad: Table = field(default_factory=lambda: constant(0.0))
    """cross slope, positive if the left side is higher"""
    grade: Table = field(default_factory=lambda: constant(0.0))
    """rise over distance, positive uphill"""
    width_m: Table | None = None
    """of the lane around the reference line; None: not limited"""
    length_m: float = inf
    """the drive is over where the road ends"""

    def at(self, s_m: float, tail_wind_mps: float = 0.0, cross_wind_mps: float = 0.0) -> RoadAt:
        """The ground under a car that is parallel to the road at arc length `s_m`."""
        return RoadAt(
            curvature_per_m=self.curvature_per_m.at(s_m),
            curvature_change_per_m2=self.curvature_per_m.slope_at(s_m),
            friction_left=self.friction_left.at(s_m),
            friction_right=self.friction_right.at(s_m),
            bank_rad=self.bank_rad.at(s_m),
            grade_rad=atan(self.grade.at(s_m)),
            wind_forward_mps=tail_wind_mps,
            wind_left_mps=cross_wind_mps,
        )

    def curvature_ahead(self, s_m: float, reach_m: float, count: int = CURVATURE_KNOTS) -> Array:
        """(count,) curvature in 1/m at equal distances from the car to `reach_m` ahead of it."""
        return self.curvature_per_m(s_m + np.linspace(0.0, reach_m, count))

    def frame(self) -> CurvatureTable:
        """The curvature as the compiled road frame reads it."""
        table = self.curvature_per_m
        return CurvatureTable(table.starts, table.coefficients)

    @property
    def uniform_friction(self) -> float | None:
        """The friction, if it is the same everywhere and on both sides; None if it is not."""
        left, right = self.friction_left, self.friction_right
        values = {left.at(0.0), right.at(0.0)}
        if left.is_constant and right.is_constant and len(values) == 1:
            return values.pop()
        return None
