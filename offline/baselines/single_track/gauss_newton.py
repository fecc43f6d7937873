"""Damped Gauss-Newton for models with few parameters and an error over a horizon.

The objective is the mean over the states of log(mean squared error). In each step this is a
least-squares problem in which each state's residuals are divided by their present root mean square.
The Jacobian comes from forward differences: for a hundred parameters of a compiled model, a hundred
simulations are faster than differentiation step by step.

Levenberg (1944) and Marquardt (1963) for the damping.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg

from offline.baselines.score import log_mean_square
from rt_controller.contract.arrays import Array

Residuals = Callable[[Array], Array]
"""parameters theta (P,) to errors (batch, K, n) in any units"""

_DIFFERENCE = 1e-5
_ADDED_CURVATURE = 1e-6
"""share of the mean diagonal that is added to it: data may not determine all parameters"""

_MEMORY = 0.9
"""factor on the curvature of earlier steps: it averages over about ten of them"""

_FIRST_DAMPING, _LEAST_DAMPING = 0.1, 1e-4
_EASE, _STIFFEN = 3.0, 4.0
_TRIES = 6


class Trust(NamedTuple):
    """State between two steps."""

    damping: float
    """share of the curvature's diagonal that is added to it"""
    curvature: Array
    """(P, P) products of all Jacobians so far, with exponentially smaller weights"""


def begin(parameters: int) -> Trust:
    """The state before the first step."""
    return Trust(_FIRST_DAMPING, np.zeros((parameters, parameters)))


def step(
    theta: Array, residuals: Residuals, test_residuals: Residuals, trust: Trust
) -> tuple[Array, Trust]:
    """The next theta (P,) and state; theta is unchanged if no step lowers the test error.

    `residuals` may be of a few windows that change from step to step; `test_residuals` are of many
    fixed windows, so a step that only improves the few is not taken.
    """
    errors = residuals(theta)
    weights = 1.0 / np.sqrt(np.mean(np.square(errors), axis=(0, 1)))
    weighted = (errors * weights).reshape(-1)
    J = np.empty((len(theta), len(weighted)))
    for i in range(len(theta)):
        moved = theta.copy()
        moved[i] += _DIFFERENCE
        J[i] = ((residuals(moved) - errors) * weights).reshape(-1) / _DIFFERENCE
    J = np.where(np.isfinite(J), J, 0.0)
    curvature, gradient = _MEMORY * trust.curvature + J @ J.T, J @ weighted
    diagonal = np.diag(curvature) + _ADDED_CURVATURE * np.trace(curvature) / len(theta)
    before, damping = log_mean_square(test_residuals(theta)), trust.damping
    for _ in range(_TRIES):
        matrix = curvature + np.diag(damping * diagonal)
        candidate = theta - scipy.linalg.solve(matrix, gradient, assume_a="pos")
        if log_mean_square(test_residuals(candidate)) < before:
            return candidate, Trust(max(damping / _EASE, _LEAST_DAMPING), curvature)
        damping *= _STIFFEN
    return theta, Trust(_STIFFEN * trust.damping, curvature)
