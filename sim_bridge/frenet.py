"""The road frame: position and heading of a moving body relative to a road of given curvature.

s is the arc length along the reference line, e_y the distance to its left, e_psi the heading
relative to its tangent. The motion of the car does not depend on them; they are integrated from the
motion, which is linear between the points of the fine grid, with a Runge-Kutta step of fourth order
for each interval.
Paper: eq. (2), "set of states and inputs".
"""

from math import cos, sin

import numpy as np

from rt_controller.contract.arrays import Array
from sim_bridge.plant.jit import compiled

S, EY, EPSI = 0, 1, 2
"""columns of a pose on the road: s_m, ey_m, epsi_rad"""

_LEAST_GAP = 0.05
"""lower limit of 1 - curvature * e_y; the frame is not defined beyond the centre of the bend"""


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
def advance_pose(
    before: Array, motion: Array, curvature_per_m: float, step_s: float, pose: Array
) -> None:
    """Integrate `pose` (s_m, ey_m, epsi_rad) over a piece of motion, in place.

    Args:
        before: (3,), (vx_mps, vy_mps, yaw_rate_radps) at the start.
        motion: (M, 3), the same after each of M steps.
    """
    half_s, sixth_s = 0.5 * step_s, step_s / 6.0
    vx0, vy0, yaw_rate0 = before[0], before[1], before[2]
    for i in range(motion.shape[0]):
        vx1, vy1, yaw_rate1 = motion[i, 0], motion[i, 1], motion[i, 2]
        vx_mid, vy_mid, yaw_mid = (
            0.5 * (vx0 + vx1),
            0.5 * (vy0 + vy1),
            0.5 * (yaw_rate0 + yaw_rate1),
        )
        ey, epsi = pose[EY], pose[EPSI]
        s1, y1, a1 = _rates(vx0, vy0, yaw_rate0, curvature_per_m, ey, epsi)
        s2, y2, a2 = _rates(
            vx_mid, vy_mid, yaw_mid, curvature_per_m, ey + half_s * y1, epsi + half_s * a1
        )
        s3, y3, a3 = _rates(
            vx_mid, vy_mid, yaw_mid, curvature_per_m, ey + half_s * y2, epsi + half_s * a2
        )
        s4, y4, a4 = _rates(
            vx1, vy1, yaw_rate1, curvature_per_m, ey + step_s * y3, epsi + step_s * a3
        )
        pose[S] += sixth_s * (s1 + 2.0 * (s2 + s3) + s4)
        pose[EY] += sixth_s * (y1 + 2.0 * (y2 + y3) + y4)
        pose[EPSI] += sixth_s * (a1 + 2.0 * (a2 + a3) + a4)
        vx0, vy0, yaw_rate0 = vx1, vy1, yaw_rate1


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
    poses = np.empty((n_periods + 1, 3))
    poses[0, S], poses[0, EY], poses[0, EPSI] = 0.0, ey0_m, epsi0_rad
    for k in range(n_periods):
        for i in range(3):  # assigning a row takes the compiler two seconds
            poses[k + 1, i] = poses[k, i]
        first = k * steps_per_period
        advance_pose(
            motion[first],
            motion[first + 1 : first + steps_per_period + 1],
            curvature_per_m,
            step_s,
            poses[k + 1],
        )
    return poses
