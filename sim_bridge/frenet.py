"""The road frame: where a moving body is along and beside a road of given curvature.

s runs along the reference line, e_y is the distance to its left, e_psi the heading against its
tangent. The car's own motion does not depend on them, so they are integrated along it. On the
fine grid the motion is known at both ends of each step and taken as linear between them; a step
is one Runge-Kutta step of fourth order.
Paper: eq. (2), "set of states and inputs".
"""

from math import cos, sin

import numpy as np
from numpy import float64
from numpy.typing import NDArray

from sim_bridge.plant.jit import compiled

S, EY, EPSI = 0, 1, 2
"""columns of a pose on the road: s_m, ey_m, epsi_rad"""

_LEAST_GAP = 0.05
"""of 1 - curvature * e_y: beyond the centre of the bend the frame ends, and progress is bounded"""


@compiled
def _step(
    vx0: float,
    vy0: float,
    yaw_rate0: float,
    vx1: float,
    vy1: float,
    yaw_rate1: float,
    curvature_per_m: float,
    step_s: float,
    pose: NDArray[float64],
) -> None:
    vx_mid = 0.5 * (vx0 + vx1)
    vy_mid = 0.5 * (vy0 + vy1)
    yaw_mid = 0.5 * (yaw_rate0 + yaw_rate1)
    ey = pose[EY]
    epsi = pose[EPSI]
    half_s = 0.5 * step_s

    s1, y1, a1 = _rates(vx0, vy0, yaw_rate0, curvature_per_m, ey, epsi)
    s2, y2, a2 = _rates(
        vx_mid, vy_mid, yaw_mid, curvature_per_m, ey + half_s * y1, epsi + half_s * a1
    )
    s3, y3, a3 = _rates(
        vx_mid, vy_mid, yaw_mid, curvature_per_m, ey + half_s * y2, epsi + half_s * a2
    )
    s4, y4, a4 = _rates(vx1, vy1, yaw_rate1, curvature_per_m, ey + step_s * y3, epsi + step_s * a3)
    sixth_s = step_s / 6.0
    pose[S] += sixth_s * (s1 + 2.0 * (s2 + s3) + s4)
    pose[EY] += sixth_s * (y1 + 2.0 * (y2 + y3) + y4)
    pose[EPSI] += sixth_s * (a1 + 2.0 * (a2 + a3) + a4)


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
def follow(
    before: NDArray[float64],
    motion: NDArray[float64],
    curvature_per_m: float,
    step_s: float,
    pose: NDArray[float64],
) -> None:
    """Move `pose` (s_m, ey_m, epsi_rad) on along a piece of motion, in place.

    Args:
        before: (3,), (vx_mps, vy_mps, yaw_rate_radps) at the start.
        motion: (M, 3), the same after each of M steps.
    """
    if motion.shape[0] == 0:
        return
    _step(
        before[0], before[1], before[2],
        motion[0, 0], motion[0, 1], motion[0, 2],
        curvature_per_m, step_s, pose,
    )  # fmt: skip
    for i in range(motion.shape[0] - 1):
        _step(
            motion[i, 0], motion[i, 1], motion[i, 2],
            motion[i + 1, 0], motion[i + 1, 1], motion[i + 1, 2],
            curvature_per_m, step_s, pose,
        )  # fmt: skip


@compiled
def roll_out(
    motion: NDArray[float64],
    curvature_per_m: float,
    ey0_m: float,
    epsi0_rad: float,
    steps_per_period: int,
    step_s: float,
) -> NDArray[float64]:
    """(K + 1, 3) poses (s_m, ey_m, epsi_rad) at the periods' ends along a whole motion, s from 0.

    Args:
        motion: (K * steps_per_period + 1, 3), (vx_mps, vy_mps, yaw_rate_radps).
    """
    n_periods = (motion.shape[0] - 1) // steps_per_period
    poses = np.empty((n_periods + 1, 3))
    pose = np.array((0.0, ey0_m, epsi0_rad))
    poses[0] = pose
    for k in range(n_periods):
        first = k * steps_per_period
        follow(
            motion[first],
            motion[first + 1 : first + steps_per_period + 1],
            curvature_per_m,
            step_s,
            pose,
        )
        poses[k + 1] = pose
    return poses
