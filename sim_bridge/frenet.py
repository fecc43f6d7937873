"""The road frame: position and heading of a moving body relative to a road of given curvature.

s is the arc length along the reference line, e_y the distance to its left, e_psi the heading
relative to its tangent. The motion of the car does not depend on them; they are integrated from the
motion, which is linear between the points of the fine grid, with a Runge-Kutta step of fourth order
for each interval.
Paper: eq. (2), "set of states and inputs".
"""

from math import cos, sin
from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from sim_bridge.plant.jit import compiled

S, EY, EPSI = 0, 1, 2
"""columns of a pose on the road: s_m, ey_m, epsi_rad"""

_LEAST_GAP = 0.05
"""lower limit of 1 - curvature * e_y; the frame is not defined beyond the centre of the bend"""


class CurvatureTable(NamedTuple):
    """Curvature over arc length, as polynomials of third order; constant outside of the knots."""

    starts_m: Array
    """(n,), increasing"""
    coefficients: Array
    """(n, 4), ascending powers of the distance from the start of the piece"""


@compiled
def constant_curvature(curvature_per_m: float) -> CurvatureTable:
    """The table of a circle."""
    coefficients = np.zeros((1, 4))
    coefficients[0, 0] = curvature_per_m
    return CurvatureTable(np.zeros(1), coefficients)


@compiled
def curvature_at(s_m: float, table: CurvatureTable) -> float:
    """Curvature in 1/m at one arc length."""
    piece = 0
    after = len(table.starts_m)
    while after - piece > 1:
        middle = (piece + after) // 2
        if table.starts_m[middle] <= s_m:
            piece = middle
        else:
            after = middle
    d = max(0.0, s_m - table.starts_m[piece])
    c = table.coefficients[piece]
    c0, c1, c2, c3 = c[0], c[1], c[2], c[3]
    value: float = c0 + d * (c1 + d * (c2 + d * c3))
    return value


@compiled
def _rates(
    vx: float, vy: float, yaw_rate: float, curvature_per_m: float, ey: float, epsi: float
) -> tuple[float, float, float]:
    """(ds/dt, de_y/dt, de_psi/dt)."""
    c = cos(epsi)
    s = sin(epsi)
    progress = (vx * c - vy * s) / max(_LEAST_GAP, 1.0 - curvature_per_m * ey)
    return progress, vx * s + vy * c, yaw_rate - curvature_per_m * progress


@compiled
def advance_interval(
    before: Array, after: Array, curvature_per_m: float, step_s: float, pose: Array
) -> None:
    """Integrate `pose` (s_m, ey_m, epsi_rad) over one step of linear motion, in place.

    Args:
        before: (3,), (vx_mps, vy_mps, yaw_rate_radps) at the start.
        after: (3,), the same at the end.
    """
    half_s, sixth_s = 0.5 * step_s, step_s / 6.0
    vx_mid, vy_mid = 0.5 * (before[0] + after[0]), 0.5 * (before[1] + after[1])
    yaw_mid = 0.5 * (before[2] + after[2])
    ey, epsi = pose[EY], pose[EPSI]
    s1, y1, a1 = _rates(before[0], before[1], before[2], curvature_per_m, ey, epsi)
    s2, y2, a2 = _rates(
        vx_mid, vy_mid, yaw_mid, curvature_per_m, ey + half_s * y1, epsi + half_s * a1
    )
    s3, y3, a3 = _rates(
        vx_mid, vy_mid, yaw_mid, curvature_per_m, ey + half_s * y2, epsi + half_s * a2
    )
    s4, y4, a4 = _rates(
        after[0], after[1], after[2], curvature_per_m, ey + step_s * y3, epsi + step_s * a3
    )
    pose[S] += sixth_s * (s1 + 2.0 * (s2 + s3) + s4)
    pose[EY] += sixth_s * (y1 + 2.0 * (y2 + y3) + y4)
    pose[EPSI] += sixth_s * (a1 + 2.0 * (a2 + a3) + a4)


@compiled
def advance_along(
    before: Array, motion: Array, curvature: CurvatureTable, step_s: float, pose: Array
) -> None:
    """Integrate `pose` (s_m, ey_m, epsi_rad) over a piece of motion, in place.

    The curvature of each step is that at its middle, estimated from the progress at its start; an
    end of a table piece is thus passed with an error of at most half a step of distance.

    Args:
        before: (3,), (vx_mps, vy_mps, yaw_rate_radps) at the start.
        motion: (M, 3), the same after each of M steps.
        curvature: of the reference line.
    """
    _advance_with(before, motion[0], curvature, step_s, pose)
    for i in range(1, len(motion)):
        _advance_with(motion[i - 1], motion[i], curvature, step_s, pose)


@compiled
def _advance_with(
    before: Array, after: Array, curvature: CurvatureTable, step_s: float, pose: Array
) -> None:
    middle_m = pose[S] + 0.5 * step_s * (0.5 * (before[0] + after[0])) * cos(pose[EPSI])
    advance_interval(before, after, curvature_at(middle_m, curvature), step_s, pose)


@compiled
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
    n_periods = (motion.shape[0] - 1) // steps_per_period
    curvature = constant_curvature(curvature_per_m)
    poses = np.empty((n_periods + 1, 3))
    poses[0, S], poses[0, EY], poses[0, EPSI] = 0.0, ey0_m, epsi0_rad
    for k in range(n_periods):
        for i in range(3):  # assigning a row takes the compiler two seconds
            poses[k + 1, i] = poses[k, i]
        first = k * steps_per_period
        advance_along(
            motion[first],
            motion[first + 1 : first + steps_per_period + 1],
            curvature,
            step_s,
            poses[k + 1],
        )
    return poses
