"""Poses on a plane in the Frenet frame of a road of constant curvature.

The motion on a plane does not depend on the road, so one episode can be used with any road near
its start: the reference circle is placed such that lateral and heading error have given values at
one instant, and every other pose is projected onto it. This is exact; integrating along the road
would be approximate.
Paper: eq. (2), "set of states and inputs".
"""

from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array

_LEAST_ANGLE = 1e-6
"""below this, atan(z) / z is 1 in double precision"""


class Anchor(NamedTuple):
    """The road of each trajectory: its curvature, and the errors at the first pose."""

    curvature_per_m: Array
    """(N,)"""
    ey_m: Array
    """(N,)"""
    epsi_rad: Array
    """(N,)"""


class RoadPose(NamedTuple):
    """Positions in the Frenet frame."""

    s_m: Array
    """(N, T), 0 at the first pose"""
    ey_m: Array
    epsi_rad: Array


def onto_road(pose: Array, anchor: Anchor) -> RoadPose:
    """Poses (N, T, 3), columns X_m, Y_m and yaw_rad, in the frames of the anchored roads.

    Valid up to a quarter of the circle ahead.
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
