"""The path of least curvature through lanes, as a linear program.

The unknowns are the lateral positions of the centre of gravity on a grid of arc length. Its body,
taken as parallel to the path, stays inside every lane with a clearance. What is minimised is the
peak of the curvature, and with a smaller weight the peak of its change, which the steering rate
limits.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

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
    from scipy.sparse import coo_array, eye_array, hstack, vstack

    first_m = lanes[0].start_m - LEAD_M
    n = round((lanes[-1].end_m + LEAD_M - first_m) / GRID_M) + 1
    s_m = first_m + GRID_M * np.arange(n)

    rows: list[int] = []
    columns: list[int] = []
    entries: list[float] = []
    limits: list[float] = []
    for forward_m in np.linspace(-body.rear_m, body.front_m, _SIDE_POINTS):
        for i in range(1, n - 1):
            for lane in lanes:
                if not lane.start_m <= s_m[i] + forward_m <= lane.end_m:
                    continue
                lever = 0.5 * forward_m / GRID_M
                half_m = 0.5 * body.width_m + clearance_m
                for sign, edge_m in ((1.0, lane.left_m), (-1.0, -lane.right_m)):
                    rows += [len(limits)] * 3
                    columns += [i - 1, i, i + 1]
                    entries += [-sign * lever, sign, sign * lever]
                    limits.append(edge_m - half_m)
    sides = coo_array((entries, (rows, columns)), (len(limits), n + 2)).tocsr()

    bend = _difference(n, (1.0, -2.0, 1.0)) / GRID_M**2
    change = _difference(n, (-1.0, 3.0, -3.0, 1.0)) / GRID_M**3
    peaks = []
    for k, derivative in enumerate((bend, change)):
        peak = coo_array(
            (np.ones(derivative.shape[0]), (range(derivative.shape[0]), [k] * derivative.shape[0])),
            (derivative.shape[0], 2),
        )
        peaks += [hstack([derivative, -peak]), hstack([-derivative, -peak])]

    middle_m = 0.5 * (lanes[-1].right_m + lanes[-1].left_m)
    pinned = eye_array(n, n + 2).tocsr()[[0, 1, 2, n - 3, n - 2, n - 1]]
    found = linprog(
        np.concatenate((np.zeros(n), (1.0, CHANGE_WEIGHT_M))),
        A_ub=vstack([sides, *peaks]).tocsr(),
        b_ub=np.concatenate((limits, np.zeros(sum(part.shape[0] for part in peaks)))),
        A_eq=pinned,
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


def _difference(n: int, weights: Sequence[float]) -> Any:
    """(n - len(weights) + 1, n) sparse matrix of weighted neighbours."""
    from scipy.sparse import diags_array

    m = n - len(weights) + 1
    return diags_array(weights, offsets=range(len(weights)), shape=(m, n))
