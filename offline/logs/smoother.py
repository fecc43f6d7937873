"""Kalman filter forwards, Rauch-Tung-Striebel smoother backwards, for many pieces at once."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array


class Gaussian(NamedTuple):
    """Mean (T, B, n) and covariance (T, B, n, n) of a state, of B pieces."""

    mean: Array
    covariance: Array


class StateSpace(NamedTuple):
    """s[k+1] = transition s[k] + drift + noise; m measurements, row by row."""

    transition: Array
    """(T-1, B, n, n)"""
    drift: Array
    """(T-1, B, n)"""
    noise: Array
    """(T-1, B, n, n) covariance"""
    rows: Array
    """(m, n)"""
    measured: Array
    """(m, T, B); NaN: none"""
    variance: Array
    """(m,)"""
    is_free: NDArray[np.bool_]
    """(m,) true where the variance is not known"""
    start: Gaussian
    """(B, n) and (B, n, n) before the first measurement"""


def smooth(model: StateSpace) -> Gaussian:
    """State at every step, given all measurements of its piece."""
    steps = model.measured.shape[1]
    mean, cov = model.start
    before: list[tuple[Array, Array]] = []
    after: list[tuple[Array, Array]] = []
    for k in range(steps):
        if k:
            move = model.transition[k - 1]
            mean = np.einsum("bij,bj->bi", move, mean) + model.drift[k - 1]
            cov = move @ cov @ move.swapaxes(1, 2) + model.noise[k - 1]
        before.append((mean, cov))
        for row, measured, variance in zip(
            model.rows, model.measured[:, k], model.variance, strict=True
        ):
            is_known = np.isfinite(measured)
            if not is_known.any():
                continue
            ph = cov @ row
            gain = np.where(is_known, 1.0 / (ph @ row + variance), 0.0)[:, None] * ph
            error = np.where(is_known, measured - mean @ row, 0.0)
            mean = mean + gain * error[:, None]
            cov = cov - gain[:, :, None] * ph[:, None, :]
        after.append((mean, cov))
    found = [after[-1]]
    for k in range(steps - 2, -1, -1):
        (own, own_cov), (ahead, ahead_cov) = after[k], before[k + 1]
        back = np.linalg.solve(ahead_cov, model.transition[k] @ own_cov).swapaxes(1, 2)
        mean, cov = found[-1]
        found.append(
            (
                own + np.einsum("bij,bj->bi", back, mean - ahead),
                own_cov + back @ (cov - ahead_cov) @ back.swapaxes(1, 2),
            )
        )
    means, covs = zip(*reversed(found), strict=True)
    return Gaussian(np.array(means), np.array(covs))
