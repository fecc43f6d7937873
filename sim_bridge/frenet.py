"""The road frame: position and heading of a moving body relative to a road of given curvature.

s is the arc length along the reference line, e_y the distance to its left, e_psi the heading
relative to its tangent. The integration is in `plant/c/road.c`.
Paper: eq. (2), "set of states and inputs".
"""

import ctypes

import numpy as np

from rt_controller.contract.arrays import Array
from sim_bridge.plant.library import car_library
from sim_bridge.scenario.table import Table, constant

S, EY, EPSI = 0, 1, 2
"""columns of a pose on the road: s_m, ey_m, epsi_rad"""


class _Curvature(ctypes.Structure):
    _fields_ = (
        ("n_pieces", ctypes.c_int),
        ("starts_m", ctypes.c_void_p),
        ("coefficients", ctypes.c_void_p),
    )


def advance_along(
    before: Array, motion: Array, curvature: Table, step_s: float, pose: Array
) -> None:
    """Integrate `pose` (s_m, ey_m, epsi_rad) over a piece of motion, in place.

    Args:
        before: (3,), (vx_mps, vy_mps, yaw_rate_radps) at the start.
        motion: (M, 3), the same after each of M steps.
        curvature: of the reference line.
    """
    road = _road(curvature)
    moved = np.ascontiguousarray(motion, dtype=float)
    car_library().road_advance(before, moved, len(moved), ctypes.byref(road), step_s, pose)


def integrate_poses(
    motion: Array,
    curvature_per_m: float,
    ey0_m: float,
    epsi0_rad: float,
    steps_per_period: int,
    step_s: float,
) -> Array:
    """(K + 1, 3) poses (s_m, ey_m, epsi_rad) at the periods' ends of a whole motion; s starts at 0.

    Args:
        motion: (K * steps_per_period + 1, 3), (vx_mps, vy_mps, yaw_rate_radps).
    """
    n_periods = (len(motion) - 1) // steps_per_period
    circle = constant(curvature_per_m)
    road = _road(circle)
    moved = np.ascontiguousarray(motion, dtype=float)
    poses = np.empty((n_periods + 1, 3))
    poses[0] = 0.0, ey0_m, epsi0_rad
    numbers = n_periods, steps_per_period, ctypes.byref(road), step_s
    car_library().road_poses(moved, *numbers, poses)
    return poses


def _road(curvature: Table) -> _Curvature:
    """Valid as long as the table is."""
    starts_m, coefficients = curvature.starts, curvature.coefficients
    return _Curvature(len(starts_m), starts_m.ctypes.data, coefficients.ctypes.data)
