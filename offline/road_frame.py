"""Poses on a plane, seen from a road of constant curvature laid under them anywhere.

A car does not feel which road it is on, so one drive is a drive on any road that passes near its
start: the reference circle is laid such that lateral and heading error have the wanted values at
one instant, and every other pose is projected onto it. Exact, where an integration along the
road would be approximate.
Paper: eq. (2), "set of states and inputs".
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_LEAST_ANGLE = 1e-6
"""below, atan(z) / z is 1 in double precision"""


class Anchor(NamedTuple):
    """The road of each trajectory, by what the car makes of it at the first pose."""

    curvature_per_m: Array
    """(N,)"""
    ey_m: Array
    """(N,)"""
    epsi_rad: Array
    """(N,)"""


class RoadPose(NamedTuple):
    """Where along and beside its road a car is."""

    s_m: Array
    """(N, T), 0 at the first pose"""
    ey_m: Array
    epsi_rad: Array


def onto_road(pose: Array, anchor: Anchor) -> RoadPose:
    """Poses (N, T, 3), columns X_m, Y_m and yaw_rad, along the roads that `anchor` lays.

    Exact up to a quarter of a circle ahead.
    """
    kappa, ey, epsi = (column[:, None] for column in anchor)
    moved = pose - pose[:, :1]
    turn = epsi - pose[:, :1, 2]
    along = np.cos(turn) * moved[..., 0] - np.sin(turn) * moved[..., 1]
    beside = np.sin(turn) * moved[..., 0] + np.cos(turn) * moved[..., 1] + ey

    # The circle's centre is (0, 1/kappa); these forms stay exact as kappa goes to zero.
    towards_centre = 1.0 - kappa * beside
    radius_ratio = np.hypot(kappa * along, towards_centre)
    lateral = (2.0 * beside - kappa * (along**2 + beside**2)) / (1.0 + radius_ratio)
    z = kappa * along / towards_centre
    is_small = np.abs(z) < _LEAST_ANGLE
    arc_per_chord = np.where(is_small, 1.0, np.arctan(z) / np.where(is_small, 1.0, z))
    s = along / towards_centre * arc_per_chord
    return RoadPose(s, lateral, epsi + moved[..., 2] - kappa * s)
