"""The path of a car whose motion is predicted: kinematics on a road of constant curvature.

The motion on a plane does not depend on the road, so a model of the motion alone predicts the path
on every road. The car moves along its heading in the middle of a period; the projection onto the
circle of the road is exact.
"""

from collections.abc import Sequence
from math import atan2, cos, hypot, sin
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


def path_of(moved: Array, curvature_per_m: float, path: Array) -> Array:
    """Path states (K, 3), columns Δs, e_y, e_psi, of a car at the ends of K periods.

    Args:
        moved: (K, 3), the movement in each period, as `Movement`.
        curvature_per_m: of the road.
        path: (3,), path states at the begin.
    """
    ahead, left, turn = moved.T
    turned = np.cumsum(turn)
    turned += path[2]
    middle = turned - 0.5 * turn
    cosine, sine = np.cos(middle), np.sin(middle)
    y_m = np.cumsum(ahead * sine + left * cosine)
    y_m += path[1]
    place = project(np.cumsum(ahead * cosine - left * sine), y_m, curvature_per_m)
    found = np.empty(moved.shape)
    found[0, 0] = place.s_m[0]
    np.subtract(place.s_m[1:], place.s_m[:-1], out=found[1:, 0])
    found[:, 1] = place.ey_m
    np.subtract(turned, place.turn_rad, out=found[:, 2])
    return found


def path_after(moved: Array, curvature_per_m: Array | float, path: Array) -> Array:
    """Path states (..., 3) of several cars a period after `path` (..., 3), moved (..., 3)."""
    ahead, left, turn = moved[..., 0], moved[..., 1], moved[..., 2]
    middle = path[..., 2] + 0.5 * turn
    cosine, sine = np.cos(middle), np.sin(middle)
    y_m = path[..., 1] + ahead * sine + left * cosine
    place = project(ahead * cosine - left * sine, y_m, curvature_per_m)
    found = np.empty(moved.shape)
    found[..., 0], found[..., 1] = place.s_m, place.ey_m
    np.subtract(path[..., 2] + turn, place.turn_rad, out=found[..., 2])
    return found


def path_of_one(moved: Array, curvature_per_m: float, path: Array) -> tuple[float, float, float]:
    """The same of one car, moved (3,), in floats: a tenth of the time."""
    (ahead, left, turn), (_, ey, epsi), kappa = moved.tolist(), path.tolist(), curvature_per_m
    middle = epsi + 0.5 * turn
    cosine, sine = cos(middle), sin(middle)
    x_m, y_m = ahead * cosine - left * sine, ey + ahead * sine + left * cosine
    sideways = 1.0 - kappa * y_m
    of_road, ratio = atan2(kappa * x_m, sideways), hypot(kappa * x_m, sideways)
    s_m = x_m / sideways if abs(of_road) < _SMALLEST_TURN else of_road / kappa
    ey_m = (2.0 * y_m - kappa * (x_m * x_m + y_m * y_m)) / (1.0 + ratio)
    return s_m, ey_m, epsi + turn - of_road


class PathDerivatives:
    """The derivatives of `path_of` over one period, by movement, e_y, e_psi and the curvature."""

    def __init__(self, movement: Movement, columns: Sequence[int], periods: int) -> None:
        """`columns` of the path states that are needed: e_y, e_psi, perhaps Δs."""
        self._movement = movement
        place = np.eye(movement.S.shape[1])[[StateColumn.ey_m, StateColumn.epsi_rad]]
        self._S = np.vstack([movement.S, place])
        """(5, n)"""
        self.columns = list(columns)
        self._rows = {c: i for i, c in enumerate(columns)}
        self._values = np.zeros((periods, len(columns), 5))
        self._by_curvature = np.zeros((periods, len(columns)))

    def along(self, psi: Array, curvature_per_m: float) -> tuple[Array, Array]:
        """Of `columns`, by psi (K, c, n) and by the curvature (K, c).

        Along lifted states (K + 1, n).
        """
        moved = psi[:-1] @ self._movement.S.T + self._movement.s0
        values, by_curvature = self.at(moved, curvature_per_m, psi[:, PATH_STATES])
        return values @ self._S, by_curvature

    def at(self, moved: Array, curvature_per_m: float, path: Array) -> tuple[Array, Array]:
        """Of `columns`, by movement, e_y and e_psi (K, c, 5), and by the curvature (K, c).

        For K periods: the movement (K, 3) in them, path states (K + 1, 3) at their begins and at
        the last end.
        """
        (ahead, left, turned), kappa = moved.T, curvature_per_m
        ds, ey, epsi = path.T
        of_road = epsi[:-1] + turned - epsi[1:]
        after = epsi[1:] - 0.5 * turned  # heading of the movement, seen from the road at its end
        c, s, cos_road, sin_road = np.cos(after), np.sin(after), np.cos(of_road), np.sin(of_road)
        along, across = ahead * c - left * s, ahead * s + left * c
        radius_ratio = 1.0 - kappa * ey[1:]

        values, by_curvature = self._values, self._by_curvature
        to_ey = values[:, self._rows[StateColumn.ey_m]].T
        to_ey[0], to_ey[1], to_ey[2], to_ey[3], to_ey[4] = s, c, 0.5 * along, cos_road, along
        # Of Δs; kappa times it is the turn of the road.
        to_ds = np.stack((c, -s, -0.5 * across, sin_road, -across))
        to_ds /= radius_ratio
        to_epsi = values[:, self._rows[StateColumn.epsi_rad]].T
        np.multiply(to_ds, -kappa, out=to_epsi)
        to_epsi[2] += 1.0
        to_epsi[4] += 1.0

        x_m, y_m = along * cos_road - across * sin_road, along * sin_road + across * cos_road
        y_m += ey[:-1]
        squared, one = x_m * x_m + y_m * y_m, 1.0 + radius_ratio
        by_ratio = (kappa * squared - y_m) / radius_ratio
        numerator = 2.0 * y_m - kappa * squared
        by_turn = x_m / (radius_ratio * radius_ratio)
        ey_row, epsi_row = self._rows[StateColumn.ey_m], self._rows[StateColumn.epsi_rad]
        by_curvature[:, ey_row] = (-squared * one - numerator * by_ratio) / (one * one)
        by_curvature[:, epsi_row] = -by_turn
        if StateColumn.ds_m in self._rows:
            values[:, self._rows[StateColumn.ds_m]] = to_ds.T
            is_straight = abs(kappa) < _STRAIGHT_PER_M
            by_ds = x_m * y_m if is_straight else (by_turn - ds[1:]) / kappa
            by_curvature[:, self._rows[StateColumn.ds_m]] = by_ds
        return values, by_curvature
