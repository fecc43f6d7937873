"""A linear model of the physical states, trained on the error over two seconds.

It shows what lifting adds: a lifted model is trained on the same error and the same trajectories,
but has observables beyond the states. L-BFGS (Liu and Nocedal, 1989) starts from least squares and
lowers the log error of `offline.baselines.score`; the gradient comes from the adjoint recursion
l_k = g_k + A' l_(k+1), in double precision.
"""

import numpy as np
import scipy.optimize

from offline.baselines.baseline import Baseline
from offline.baselines.linear_model import LinearModel, fit_one_step, to_bundle
from offline.baselines.score import variances
from offline.data.dataset import Dataset
from offline.data.trajectories import Trajectories
from rt_controller.contract.arrays import Array
from rt_controller.contract.model.rollout import Matrices

MOST_TRAJECTORIES = 12_000
"""evenly spread over the training part"""
ITERATIONS = 300

_SMALLEST_SPREAD = 1e-9
"""of a constant signal, relative to signals of size 1"""


def fit_on_horizon(dataset: Dataset) -> LinearModel:
    """The linear model with the smallest log error that L-BFGS reaches from least squares."""
    train = dataset.select("train")
    start = fit_one_step(train, dataset.schema, dataset.roles)
    every = -(-len(train.episode) // MOST_TRAJECTORIES)
    train = train.take(slice(None, None, every))
    return LinearModel(descend(start, train, ITERATIONS))


def descend(start: Matrices, train: Trajectories, iterations: int) -> Matrices:
    """The matrices that L-BFGS reaches from `start` on these trajectories."""
    # The regressors are whitened: differences in size and correlations slow the descent down.
    n, m, p = len(start.A), start.B_uc.shape[1], start.B_uw.shape[1]
    x_scale = np.sqrt(variances(train.x))
    driven = np.concatenate([train.u, train.w], axis=2).astype(np.float64)
    driven_scale = np.sqrt(np.mean(np.square(driven), axis=(0, 1)))
    driven_scale = np.append(np.where(driven_scale > 0.0, driven_scale, 1.0), 1.0)
    driven = np.concatenate([driven, np.ones((*driven.shape[:2], 1))], axis=2) / driven_scale
    # Time first, and in units in which every state has variance 1.
    x = np.ascontiguousarray(np.swapaxes(train.x / x_scale, 0, 1))
    driven = np.ascontiguousarray(np.swapaxes(driven, 0, 1))
    physical = np.concatenate([start.A, start.B_uc, start.B_uw, start.c[:, None]], axis=1)
    columns = np.concatenate([x_scale, driven_scale])
    rows = np.concatenate([x[:-1], driven], axis=2).reshape(-1, len(columns))
    moments = rows.T @ rows / len(rows)
    L = np.linalg.cholesky(moments + _SMALLEST_SPREAD * np.eye(len(moments)))
    unwhiten = np.linalg.inv(L)

    def lower(whitened: Array) -> tuple[float, Array]:
        value, gradient = _value_and_gradient(whitened.reshape(n, -1) @ unwhiten, x, driven)
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
    return Matrices(A, B_uc, B_uw, c[:, 0])


def _value_and_gradient(theta: Array, x: Array, driven: Array) -> tuple[float, Array]:
    """Mean log error of the states and its gradient (n * columns,), theta = [A, B, c].

    x (K+1, N, n) are the states; driven (K, N, m + p + 1) are inputs, exogenous signals and 1.
    """
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
    # d/dx of mean_i log(mean square_i), then the adjoint recursion; both overwrite `errors`.
    errors *= 2.0 / (n * steps * count * mean_square)
    for k in range(steps - 2, -1, -1):
        errors[k] += errors[k + 1] @ A
    adjoint = errors.reshape(-1, n)
    before = np.concatenate([predicted[:-1], driven], axis=2).reshape(len(adjoint), -1)
    return float(np.log(mean_square).mean()), (adjoint.T @ before).ravel()


BASELINE = Baseline(fit=fit_on_horizon, to_bundle=to_bundle, model_class="linear")
