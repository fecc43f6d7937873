"""One-step ridge regression in a fixed dictionary, from as many transitions as are worth it.

Sums of products are accumulated chunk by chunk in double precision, once for a dictionary; every
ridge then costs one solve. What is regressed is the change of psi over a step, so that the ridge
pulls A towards the identity and not the integrators towards forgetting.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from offline.baselines.functions import Functions
from offline.baselines.lifted_model import LiftedModel
from offline.baselines.score import log_error
from offline.roles import Roles, past_columns
from offline.scaling import Scaling
from offline.trajectories import Trajectories
from rt_controller.contract.follow import Follow
from rt_controller.contract.schema import Schema

Array = NDArray[np.float64]

_CHUNK = 10_000


class Transitions(NamedTuple):
    """Single steps of many trajectories, in physical units."""

    x: Array
    """(M, 2, n) states before and after"""
    u: Array
    """(M, m)"""
    w: Array
    """(M, p)"""
    past: Array
    """(M, 2, H, h) history before each of the two"""


class Moments(NamedTuple):
    """What a regression needs of its data: means of products, regressors r and targets n."""

    regressors: Array
    """(r, r)"""
    targets: Array
    """(r, n)"""


def pick_transitions(
    windows: Trajectories, schema: Schema, roles: Roles, past_steps: int, most: int
) -> Transitions:
    """At most so many steps, every trajectory giving some, at times spread over the horizon."""
    count, steps = windows.u.shape[:2]
    every = -(-count * steps // most)
    row, time = np.divmod(np.arange(count * steps), steps)
    chosen = (time + row) % every == 0
    row, time = row[chosen], time[chosen]
    states, inputs = past_columns(schema, roles)
    driven = np.concatenate([windows.x[:, :-1, states], windows.u[..., inputs]], axis=-1)
    memory = np.concatenate([windows.past[:, windows.past.shape[1] - past_steps :], driven], axis=1)
    both = time[:, None] + np.arange(2)
    rows = both[..., None] + np.arange(past_steps)
    return Transitions(
        windows.x[row[:, None], both].astype(np.float64),
        windows.u[row, time].astype(np.float64),
        windows.w[row, time].astype(np.float64),
        memory[row[:, None, None], rows].astype(np.float64),
    )


def blank_model(
    functions: Functions, scaling: Scaling, past_steps: int, gains: tuple[int, ...] = ()
) -> LiftedModel:
    """A model with this dictionary and no operator yet."""
    nothing = np.zeros((0, 0))
    return LiftedModel(
        *(functions.family.value, functions.rows, functions.shifts, functions.width),
        past_steps=past_steps,
        x_centre=scaling.x_centre,
        x_scale=scaling.x_scale,
        u_scale=scaling.u_scale,
        w_scale=scaling.w_scale,
        past_centre=scaling.past_centre,
        past_scale=scaling.past_scale,
        A=nothing,
        B_uc=nothing,
        B_uw=nothing,
        N=nothing,
        gains=np.array(gains, dtype=np.int64),
        follow=Follow.START.value,
        ridge=0.0,
    )


def moments(model: LiftedModel, data: Transitions) -> Moments:
    """Of the model's regressors, and of how psi changes over a step."""
    regressors: Array | float = 0.0
    targets: Array | float = 0.0
    count = len(data.u)
    for first in range(0, count, _CHUNK):
        part = slice(first, first + _CHUNK)
        w = data.w[part]
        psi = model.lift(data.x[part], np.repeat(w[:, None], 2, axis=1), data.past[part])
        before, change = psi[:, 0], psi[:, 1] - psi[:, 0]
        u = data.u[part] / model.u_scale
        rows = model.regressors(before, u, w / model.w_scale, before[:, model.gains])
        regressors = regressors + rows.T @ rows / count
        targets = targets + rows.T @ change / count
    return Moments(np.asarray(regressors), np.asarray(targets))


def solve(model: LiftedModel, of: Moments, ridge: float) -> LiftedModel:
    """The model with the operator of least squared error plus `ridge` times its squared size.

    Size counts in units of each regressor's root mean square.
    """
    spread = np.sqrt(np.diag(of.regressors))
    spread = np.where(spread > 0.0, spread, 1.0)
    correlations = of.regressors / spread[:, None] / spread[None, :]
    correlations[np.diag_indices_from(correlations)] += ridge
    # Least squares where there is no ridge: without one, observables may depend on each other.
    wanted = of.targets / spread[:, None]
    if ridge > 0.0:
        scaled = scipy.linalg.solve(correlations, wanted, assume_a="pos")
    else:
        scaled, *_ = scipy.linalg.lstsq(correlations, wanted)
    operator = (scaled / spread[:, None]).T
    n, m, p = len(operator), len(model.u_scale), len(model.w_scale)
    operator[:, :n] += np.eye(n)
    A, B_uc, B_uw, N = np.split(operator, [n, n + m, n + m + p], axis=1)
    return replace(model, A=A, B_uc=B_uc, B_uw=B_uw, N=N, ridge=ridge)


def tune(
    model: LiftedModel,
    of: Moments,
    ridges: tuple[float, ...],
    follows: tuple[Follow, ...],
    validation: Trajectories,
) -> tuple[float, LiftedModel]:
    """The least validation score over these choices, and the model that has it."""
    solved = [solve(model, of, ridge) for ridge in ridges]
    tried = [replace(each, follow=follow.value) for each in solved for follow in follows]
    scores = [log_error(each, validation) for each in tried]
    best = int(np.argmin(scores))
    return scores[best], tried[best]
