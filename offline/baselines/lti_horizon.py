"""A linear model of the physical states, trained on two seconds at once.

What lifting brings is what a lifted model gains over this one: both answer to the same figure, on
the same trajectories, and only one of them has observables beyond the states.

Least squares is the start. From there L-BFGS lowers the log error of `offline.baselines.score`
over the whole horizon, with the gradient by the adjoint recursion
l_k = g_k + A' l_(k+1), all of it in double precision (Liu and Nocedal, 1989).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from offline.baselines.least_squares import fit_one_step
from offline.baselines.linear_model import LinearModel
from offline.baselines.score import variances
from offline.dataset import Dataset
from offline.trajectories import Trajectories

Array = NDArray[np.float64]


_LEAST_SPREAD = 1e-9
"""of a signal that is constant, beside those of size 1"""


@dataclass(frozen=True, slots=True)
class HorizonSettings:
    """How long, and on how much, the linear model is trained."""

    most_trajectories: int = 12_000
    """spread evenly over the training part"""
    iterations: int = 300


class _Problem(NamedTuple):
    """Trajectories, time first, in units in which every state has variance 1."""

    x: Array
    """(K+1, N, n)"""
    driven: Array
    """(K, N, m + p + 1) inputs, exogenous signals, 1"""


def fit_on_horizon(dataset: Dataset, settings: HorizonSettings = HorizonSettings()) -> LinearModel:
    """The linear model with the least log error over the horizon that the start leads to."""
    train = dataset.select("train")
    start = fit_one_step(train, dataset.schema, dataset.roles)
    every = -(-len(train.episode) // settings.most_trajectories)
    return descend(start, train.take(slice(None, None, every)), settings.iterations)


def descend(start: LinearModel, train: Trajectories, iterations: int) -> LinearModel:
    """The model that L-BFGS finds from `start` on these trajectories."""
    # Signals of very different size, and those that go together, make a badly shaped valley: the
    # descent works on combinations of them that are of one size and do not.
    n, m, p = len(start.A), start.B_uc.shape[1], start.B_uw.shape[1]
    x_scale = np.sqrt(variances(train.x))
    driven = np.concatenate([train.u, train.w], axis=2).astype(np.float64)
    driven_scale = np.sqrt(np.mean(np.square(driven), axis=(0, 1)))
    driven_scale = np.append(np.where(driven_scale > 0.0, driven_scale, 1.0), 1.0)
    driven = np.concatenate([driven, np.ones((*driven.shape[:2], 1))], axis=2) / driven_scale
    problem = _Problem(
        np.ascontiguousarray(np.swapaxes(train.x / x_scale, 0, 1)),
        np.ascontiguousarray(np.swapaxes(driven, 0, 1)),
    )
    physical = np.concatenate([start.A, start.B_uc, start.B_uw, start.c[:, None]], axis=1)
    columns = np.concatenate([x_scale, driven_scale])
    L = _spread(problem)
    unwhiten = np.linalg.inv(L)

    def lower(whitened: Array) -> tuple[float, Array]:
        value, gradient = _value_and_gradient(whitened.reshape(n, -1) @ unwhiten, problem)
        return value, (gradient.reshape(n, -1) @ unwhiten.T).ravel()

    found = scipy.optimize.minimize(
        lower,
        (physical * columns / x_scale[:, None] @ L).ravel(),
        method="L-BFGS-B",
        jac=True,
        options={"maxiter": iterations, "maxcor": 30, "gtol": 1e-9, "ftol": 1e-12},
    )
    theta = found.x.reshape(n, -1) @ unwhiten * x_scale[:, None] / columns
    A, B_uc, B_uw, c = np.split(theta, [n, n + m, n + m + p], axis=1)
    return LinearModel(A, B_uc, B_uw, c[:, 0])


def _spread(problem: _Problem) -> Array:
    """L with L L' the mean product of the regressors [x, driven] with themselves."""
    rows = np.concatenate([problem.x[:-1], problem.driven], axis=2)
    rows = rows.reshape(-1, rows.shape[-1])
    moments = rows.T @ rows / len(rows)
    return np.linalg.cholesky(moments + _LEAST_SPREAD * np.eye(len(moments)))


def _value_and_gradient(theta: Array, problem: _Problem) -> tuple[float, Array]:
    """Mean log error of the states and its gradient (n * columns,), theta = [A, B, c]."""
    x, driven = problem
    n, steps, count = x.shape[2], len(driven), x.shape[1]
    A, drive = theta[:, :n], driven @ theta[:, n:].T
    predicted = np.empty_like(x)
    predicted[0] = x[0]
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(steps):
            predicted[k + 1] = predicted[k] @ A.T + drive[k]
        errors = predicted[1:] - x[1:]
        mean_square = np.mean(np.square(errors), axis=(0, 1))
    if not np.all(np.isfinite(mean_square)):
        return np.inf, np.zeros(theta.size)
    # d/dx of mean_i log(mean square_i), then the adjoint recursion, in place of the errors.
    errors *= 2.0 / (n * steps * count * mean_square)
    for k in range(steps - 2, -1, -1):
        errors[k] += errors[k + 1] @ A
    adjoint = errors.reshape(-1, n)
    before = np.concatenate([predicted[:-1], driven], axis=2).reshape(len(adjoint), -1)
    return float(np.log(mean_square).mean()), (adjoint.T @ before).ravel()
