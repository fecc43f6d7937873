"""The path of least curvature through lanes, as a linear program.

The unknowns are the lateral positions of the centre of gravity on a grid of arc length. Its body,
taken as parallel to the path, stays inside every lane with a clearance. What is minimised is the
peak of the curvature, and with a smaller weight the peak of its change, which the steering rate
limits.
"""

from collections.abc import Sequence

import numpy as np

from rt_controller.contract.arrays import Array
from sim_bridge.scenario.lanes import Body, Lane
from sim_bridge.scenario.table import Interpolation, Table, through

GRID_M = 0.5
LEAD_M = 30.0
"""before the first and after the last lane the path may deviate for so far"""
CHANGE_WEIGHT_M = 6.0
"""of the peak change of curvature against the peak curvature"""
_SIDE_POINTS = 5
"""points along each side of the body that are kept in the lane"""


def smoothest_path(lanes: Sequence[Lane], body: Body, clearance_m: float) -> Table:
    """Lateral position of the centre of gravity over arc length; straight before and after.

    It starts on e_y = 0 and ends in the middle of the last lane.

    Raises:
        ValueError: the body with its clearance does not fit into the lanes.
    """
    from scipy.optimize import linprog

    first_m = lanes[0].start_m - LEAD_M
    n = round((lanes[-1].end_m + LEAD_M - first_m) / GRID_M) + 1
    s_m = first_m + GRID_M * np.arange(n)
    half_m = 0.5 * body.width_m + clearance_m
    unknowns = np.eye(n, n + 2)
    """the positions, the peak of the curvature and that of its change"""
    rows: list[Array] = []
    limits: list[float] = []
    for forward_m in np.linspace(-body.rear_m, body.front_m, _SIDE_POINTS):
        lever = 0.5 * forward_m / GRID_M
        for i in range(1, n - 1):
            place = unknowns[i] + lever * (unknowns[i + 1] - unknowns[i - 1])
            for lane in lanes:
                if lane.start_m <= s_m[i] + forward_m <= lane.end_m:
                    rows += [place, -place]
                    limits += [lane.left_m - half_m, -lane.right_m - half_m]
    for order in (2, 3):
        derivative = np.diff(unknowns, order, axis=0) / GRID_M**order
        peak = np.zeros(n + 2)
        peak[n + order - 2] = 1.0
        rows += [*(derivative - peak), *(-derivative - peak)]
        limits += [0.0] * (2 * len(derivative))
    middle_m = 0.5 * (lanes[-1].right_m + lanes[-1].left_m)
    found = linprog(
        np.concatenate((np.zeros(n), (1.0, CHANGE_WEIGHT_M))),
        A_ub=np.array(rows),
        b_ub=limits,
        A_eq=unknowns[[0, 1, 2, n - 3, n - 2, n - 1]],
        b_eq=[0.0, 0.0, 0.0, middle_m, middle_m, middle_m],
        bounds=(None, None),
        method="highs",
    )
    if found.status != 0:
        raise ValueError(
            f"clearance_m: expected lanes that a body {body.width_m:g} m wide fits into with it, "
            f"found {clearance_m:g}. Make it smaller."
        )
    return through(s_m.tolist(), found.x[:n].tolist(), Interpolation.SPLINE)
