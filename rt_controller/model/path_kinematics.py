"""The path of a car whose motion is predicted: kinematics on a road of constant curvature.

The motion on a plane does not depend on the road, so a model of the motion alone predicts the path
on every road. The car moves along its heading in the middle of a period; the projection onto the
circle of the road is exact.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import PATH_STATES, StateColumn

_SMALLEST_TURN = 1e-6
"""of the road in rad; below it arc and tangent have the same length"""

_STRAIGHT_PER_M = 1e-6
"""curvature below which a period is straight"""


class Movement(NamedTuple):
    """How the car moves in the next period: S psi + s0.

    Metres ahead and to the left in the axes of the car in the middle of the period, radians turned.
    The rows are learned: the lifted state knows how the motion changes within the period.
    """

    S: Array
    """(3, n)"""
    s0: Array
    """(3,)"""


class Place(NamedTuple):
    """Places in the frame of a road of constant curvature."""

    s_m: Array
    """arc length from the origin"""
    ey_m: Array
    turn_rad: Array
    """by which the road has turned since the origin"""


def project(x_m: Array, y_m: Array, curvature_per_m: Array | float) -> Place:
    """The places of points (...) on the road that leaves the origin along the x axis.

    Within half of the circle ahead.
    """
    sideways, ahead = 1.0 - curvature_per_m * y_m, curvature_per_m * x_m
    turn = np.arctan2(ahead, sideways)
    # These forms stay exact as the curvature goes to zero.
    ey = (2.0 * y_m - curvature_per_m * (x_m * x_m + y_m * y_m)) / (1.0 + np.hypot(ahead, sideways))
    is_small = np.abs(turn) < _SMALLEST_TURN
    s = np.where(is_small, x_m / sideways, turn / np.where(is_small, 1.0, curvature_per_m))
    return Place(s, ey, turn)


def path_of(moved: Array, curvature_per_m: Array | float, path: Array) -> Array:
    """Path states (..., K, 3), columns Δs, e_y, e_psi, at the ends of K periods.

    Args:
        moved: (..., K, 3), the movement in each period, as `Movement`.
        curvature_per_m: (..., 1) of the road.
        path: (..., 3), path states at the begin.
    """
    ahead, left, turn = np.moveaxis(moved, -1, 0)
    turned = np.cumsum(turn, axis=-1) + path[..., None, 2]
    middle = turned - 0.5 * turn
    cosine, sine = np.cos(middle), np.sin(middle)
    x_m = np.cumsum(ahead * cosine - left * sine, axis=-1)
    y_m = np.cumsum(ahead * sine + left * cosine, axis=-1) + path[..., None, 1]
    place = project(x_m, y_m, curvature_per_m)
    found = np.empty(moved.shape)
    found[..., 0] = np.diff(place.s_m, axis=-1, prepend=0.0)
    found[..., 1] = place.ey_m
    found[..., 2] = turned - place.turn_rad
    return found


class PathDerivatives:
    """The derivatives of `path_of` over one period, as terms N W S of the Jacobian of psi+.

    The rows of S are the movement, e_y and e_psi; each of `columns` of psi depends on all of them.
    """

    def __init__(self, movement: Movement, columns: Sequence[int]) -> None:
        """`columns` of the path states that are needed: e_y, e_psi, perhaps Δs."""
        self._rows = [column - PATH_STATES.start for column in columns]
        unit = np.eye(movement.S.shape[1])
        place = unit[[StateColumn.ey_m, StateColumn.epsi_rad]]
        self.S = np.tile(np.vstack([movement.S, place]), (len(columns), 1))
        """(q, n)"""
        self.N = np.repeat(unit[:, list(columns)], len(self.S) // len(columns), axis=1)
        """(n, q)"""

    def at(self, moved: Array, curvature_per_m: float, path: Array) -> tuple[Array, Array]:
        """W (K, q), and derivatives (K, q) by the curvature, for K periods.

        The movement (K, 3) in them, path states (K + 1, 3) at their begins and at the last end.
        """
        ahead, left, turned = moved.T
        ey, epsi = path[:-1, 1], path[:-1, 2]
        middle = epsi + 0.5 * turned
        cosine, sine = np.cos(middle), np.sin(middle)
        x_m, beside_m = ahead * cosine - left * sine, ahead * sine + left * cosine
        y_m, kappa = ey + beside_m, curvature_per_m
        turn = np.arctan2(kappa * x_m, 1.0 - kappa * y_m)
        radius_ratio = 1.0 - kappa * path[1:, 1]
        after = middle - turn  # heading in the frame of the road at the end of the period
        c, s = np.cos(after), np.sin(after)
        cos_turn, sin_turn = np.cos(turn), np.sin(turn)
        along = x_m * cos_turn + beside_m * sin_turn
        across = beside_m * cos_turn - x_m * sin_turn

        values = np.zeros((len(moved), 3, 5))
        values[:, 0] = np.stack([c, -s, -0.5 * across, sin_turn, -across], 1)
        values[:, 0] /= radius_ratio[:, None]
        values[:, 1] = np.stack([s, c, 0.5 * along, cos_turn, along], 1)
        values[:, 2] = -kappa * values[:, 0]
        values[:, 2, [2, 4]] += 1.0

        by_curvature = np.zeros((len(moved), 3, 5))
        squared = x_m * x_m + y_m * y_m
        by_ratio = (kappa * squared - y_m) / radius_ratio
        numerator = 2.0 * y_m - kappa * squared
        one = 1.0 + radius_ratio
        by_turn = x_m / (radius_ratio * radius_ratio)
        is_straight = abs(kappa) < _STRAIGHT_PER_M
        by_curvature[:, 0, 0] = x_m * y_m if is_straight else (by_turn - path[1:, 0]) / kappa
        by_curvature[:, 1, 0] = (-squared * one - numerator * by_ratio) / (one * one)
        by_curvature[:, 2, 0] = -by_turn
        shape = len(moved), -1
        return values[:, self._rows].reshape(shape), by_curvature[:, self._rows].reshape(shape)
