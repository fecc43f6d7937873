"""Descent of a blended linear model on the error over the horizon.

L-BFGS (Liu and Nocedal, 1989) starts from the one-step fit and lowers the log error of
`offline.baselines.score`, path states included, in double precision.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.optimize
import torch

from offline.baselines.dictionary.fit import pick_transitions
from offline.baselines.scheduled.fit import weighted_regressors
from offline.baselines.scheduled.model import ScheduledModel, Series, roll_out, series_of
from offline.baselines.score import log_error, tuning_windows, variances
from offline.baselines.threads import one_thread
from offline.data.dataset import Dataset
from rt_controller.contract.arrays import Array

_WHITENING_TRANSITIONS = 40_000
_SMALLEST_SPREAD = 1e-6
"""of a constant regressor, relative to regressors of size 1"""
_FIRST_STEP = 1e-3
"""length of the first step of the descent, for regressors of variance 1"""
_DIVERGED = 1e3
"""value of a prediction that is not finite; an infinite one would end the line search"""


@dataclass(frozen=True, slots=True)
class Descent:
    """Length of the descent and size of its sample."""

    iterations: int
    check_every: int = 20
    """iterations between two looks at the validation part"""
    most_trajectories: int = 12_000
    """evenly spread over the training part"""


@one_thread()
def descend(start: ScheduledModel, dataset: Dataset, descent: Descent) -> ScheduledModel:
    """The model with the smallest validation score along the descent, `start` included."""
    structure, train = start.structure, dataset.select("train")
    L = _whitening(start, dataset)
    unwhiten = _FIRST_STEP * np.linalg.inv(L)
    J, n, r = start.theta.shape
    some = train.take(slice(None, None, -(-len(train.episode) // descent.most_trajectories)))
    x, u, w, past = (each.astype(np.float64) for each in some[:4])
    series = Series(*map(torch.from_numpy, series_of(structure, x[:, 0], past, u, w)))
    after, unit = torch.from_numpy(x[:, 1:]), torch.from_numpy(variances(x))
    knots = torch.from_numpy(structure.knots)

    def theta_of(variables: Array) -> Array:
        operator = variables.reshape(n, -1) @ unwhiten
        return np.ascontiguousarray(operator.reshape(n, J, r).swapaxes(0, 1))

    def value_and_gradient(variables: Array) -> tuple[float, Array]:
        theta = torch.from_numpy(theta_of(variables)).requires_grad_()
        errors = roll_out(torch, structure, theta, knots, series) - after
        value = (errors.square().mean(dim=(0, 1)) / unit).log().mean()
        if not torch.isfinite(value):
            return _DIVERGED, np.zeros_like(variables)
        (slope,) = torch.autograd.grad(value, theta)
        gradient = slope.numpy().swapaxes(0, 1).reshape(n, -1) @ unwhiten.T
        return value.item(), gradient.ravel()

    validation = tuning_windows(dataset)
    best, best_score, done = start, log_error(start, validation), 0

    def look(intermediate_result: scipy.optimize.OptimizeResult) -> None:
        nonlocal best, best_score, done
        done += 1
        if done % descent.check_every == 0:
            found = replace(start, theta=theta_of(intermediate_result.x), iterations=done)
            if (score := log_error(found, validation)) < best_score:
                best, best_score = found, score

    scipy.optimize.minimize(
        value_and_gradient,
        (start.theta.swapaxes(0, 1).reshape(n, -1) @ L).ravel() / _FIRST_STEP,
        method="L-BFGS-B",
        jac=True,
        callback=look,
        options={"maxiter": descent.iterations, "maxcor": 30, "gtol": 1e-9, "ftol": 1e-12},
    )
    return best


def _whitening(model: ScheduledModel, dataset: Dataset) -> Array:
    """(J r, J r) Cholesky factor of the moments of the weighted regressors.

    Differences in size and correlations of the regressors would slow the descent down.
    """
    structure = model.structure
    data = pick_transitions(
        dataset.select("train"),
        structure.schema,
        structure.roles,
        structure.past_steps,
        _WHITENING_TRANSITIONS,
    )
    rows = weighted_regressors(structure, data.x[:, 0], data.past[:, 0], data.u, data.w)
    moments = rows.T @ rows / len(rows)
    return np.asarray(np.linalg.cholesky(moments + _SMALLEST_SPREAD * np.eye(len(moments))))
