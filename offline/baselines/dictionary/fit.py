"""One-step ridge regression in a fixed dictionary.

Sums of products are accumulated chunk by chunk in double precision, once for a dictionary; each
ridge then needs one solve. The regression is of the change of psi over a step, so the ridge pulls
A towards the identity; towards zero it would make integrating states decay.
"""

from typing import NamedTuple

import numpy as np
import scipy.linalg

from offline.baselines.dictionary.model import Dictionary, LiftedModel
from offline.baselines.score import log_error
from offline.data.signals import Roles, history_rows
from offline.data.trajectories import Trajectories
from rt_controller.contract.arrays import Array
from rt_controller.contract.model.bilinear import Bilinear
from rt_controller.contract.model.follow import Follow
from rt_controller.contract.model.rollout import Matrices
from rt_controller.contract.schema import Schema

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


def moments(dictionary: Dictionary, data: Transitions) -> tuple[Array, Array]:
    """Mean products of the dictionary's regressors over a step.

    (r, r) with each other, and (r, n) with the change of psi.
    """
    scaling, count = dictionary.scaling, len(data.u)
    regressors: Array | float = 0.0
    targets: Array | float = 0.0
    for first in range(0, count, _CHUNK):
        part = slice(first, first + _CHUNK)
        w = data.w[part]
        psi = dictionary.lift(data.x[part], np.repeat(w[:, None], 2, axis=1), data.past[part])
        before, change = psi[:, 0], psi[:, 1] - psi[:, 0]
        rows = dictionary.regressors(before, data.u[part] / scaling.u_scale, w / scaling.w_scale)
        regressors = regressors + rows.T @ rows / count
        targets = targets + rows.T @ change / count
    return np.asarray(regressors), np.asarray(targets)


def ridge_solution(of: tuple[Array, Array], ridge: float) -> Array:
    """The operator (n, r) with the smallest squared error plus `ridge` times its squared size.

    `of` are mean products (r, r) of the regressors and (r, n) with the targets. The size is
    measured in units of each regressor's root mean square.
    """
    regressors, targets = of
    spread = np.sqrt(np.diag(regressors))
    spread = np.where(spread > 0.0, spread, 1.0)
    correlations = regressors / spread[:, None] / spread[None, :]
    correlations[np.diag_indices_from(correlations)] += ridge
    wanted = targets / spread[:, None]
    if ridge > 0.0:
        scaled = scipy.linalg.solve(correlations, wanted, assume_a="pos")
    else:  # regressors may be linearly dependent
        scaled, *_ = scipy.linalg.lstsq(correlations, wanted)
    return np.asarray((scaled / spread[:, None]).T)


def solve(dictionary: Dictionary, of: tuple[Array, Array], ridge: float) -> Matrices:
    """The matrices that `ridge_solution` finds for these moments."""
    operator = ridge_solution(of, ridge)
    n, m, p = len(operator), len(dictionary.scaling.u_scale), len(dictionary.scaling.w_scale)
    operator[:, :n] += np.eye(n)
    A, B_uc, B_uw, N = np.split(operator, [n, n + m, n + m + p], axis=1)
    bilinear = None
    if dictionary.gains:
        R = len(dictionary.gains)
        S = np.zeros((R, m, n))
        S[np.arange(R), :, dictionary.gains] = 1.0
        N = N.reshape(n, R, m).transpose(1, 0, 2)
        bilinear = Bilinear(N, S, np.zeros((R, m)), Follow.START)
    return Matrices(A, B_uc, B_uw, np.zeros(n), bilinear)


def tune(
    dictionary: Dictionary,
    of: tuple[Array, Array],
    ridges: tuple[float, ...],
    follows: tuple[Follow, ...],
    validation: Trajectories,
) -> tuple[float, LiftedModel]:
    """The smallest validation score over these choices, and its model; `of` are its moments."""
    tried = []
    for ridge in ridges:
        matrices = solve(dictionary, of, ridge)
        for follow in follows:
            if matrices.bilinear is not None:
                bilinear = matrices.bilinear._replace(follows=follow)
                matrices = matrices._replace(bilinear=bilinear)
            tried.append(LiftedModel(dictionary, matrices, ridge))
    scores = [log_error(model, validation) for model in tried]
    best = int(np.argmin(scores))
    return scores[best], tried[best]
