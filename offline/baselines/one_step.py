"""Ridge regression of single steps, which the models with a past and of observables are fitted by.

Sums of products are accumulated chunk by chunk in double precision; each ridge then needs one
solve. The regression is of the change over a step, so the ridge pulls A towards the identity;
towards zero it would make integrating states decay.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg

from offline.data.signals import Roles, history_rows
from offline.data.trajectories import Trajectories
from rt_controller.contract.arrays import Array
from rt_controller.contract.schema import Schema

RIDGES = (1e-10, 1e-8, 1e-6, 1e-5, 1e-4, 1e-3)
MOST_TRANSITIONS = 250_000
_CHUNK = 10_000


class Transitions(NamedTuple):
    """M single steps of many trajectories, in physical units."""

    x: Array
    """(M, 2, n) states before and after"""
    u: Array
    """(M, m)"""
    w: Array
    """(M, p)"""
    past: Array
    """(M, 2, H, h) past before each of the two"""


class Moments(NamedTuple):
    """Mean products over single steps."""

    regressors: Array
    """(r, r) of the regressors with each other"""
    targets: Array
    """(r, n) of the regressors with the targets"""


def pick_transitions(
    windows: Trajectories, schema: Schema, roles: Roles, past_steps: int, most: int
) -> Transitions:
    """At most `most` steps, from all trajectories and at times spread over the horizon."""
    count, steps = windows.u.shape[:2]
    every = -(-count * steps // most)
    row, time = np.divmod(np.arange(count * steps), steps)
    chosen = (time + row) % every == 0
    row, time = row[chosen], time[chosen]
    rows = history_rows(windows, schema, roles, past_steps)
    both = time[:, None] + np.arange(2)
    past = both[..., None] + np.arange(past_steps)
    return Transitions(
        windows.x[row[:, None], both].astype(np.float64),
        windows.u[row, time].astype(np.float64),
        windows.w[row, time].astype(np.float64),
        rows[row[:, None, None], past].astype(np.float64),
    )


def moments(data: Transitions, regression: Callable[[Transitions], tuple[Array, Array]]) -> Moments:
    """Mean products over these steps.

    `regression` returns the regressors (M, r) and targets (M, n) of some steps.
    """
    count = len(data.u)
    of_regressors: Array | float = 0.0
    of_targets: Array | float = 0.0
    for first in range(0, count, _CHUNK):
        part = Transitions(*(series[first : first + _CHUNK] for series in data))
        rows, targets = regression(part)
        of_regressors = of_regressors + rows.T @ rows / count
        of_targets = of_targets + rows.T @ targets / count
    return Moments(np.asarray(of_regressors), np.asarray(of_targets))


def ridge_solution(of: Moments, ridge: float) -> Array:
    """The operator (n, r) with the smallest squared error plus `ridge` times its squared size.

    The size is measured in units of each regressor's root mean square.
    """
    spread = np.sqrt(np.diag(of.regressors))
    spread = np.where(spread > 0.0, spread, 1.0)
    correlations = of.regressors / spread[:, None] / spread[None, :]
    correlations[np.diag_indices_from(correlations)] += ridge
    wanted = of.targets / spread[:, None]
    if ridge > 0.0:
        scaled = scipy.linalg.solve(correlations, wanted, assume_a="pos")
    else:  # regressors may be linearly dependent
        scaled, *_ = scipy.linalg.lstsq(correlations, wanted)
    return np.asarray((scaled / spread[:, None]).T)
