"""Damped Gauss-Newton for models of few numbers whose error is measured over a horizon.

What is lowered is the mean over the states of log(mean squared error). At every step this is a
least-squares problem in which each state's residuals count in units of their present root mean
square. The Jacobian comes from forward differences: a hundred numbers ask for a hundred
simulations, which for a compiled model is faster than to differentiate it step by step.

Levenberg (1944) and Marquardt (1963) for the damping.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

Array = NDArray[np.float64]
Residuals = Callable[[Array], Array]
"""of numbers theta (P,): errors (batch, K, n) in any units"""
Judged = Callable[[Array], float]
"""of numbers theta (P,): what is to be lowered"""

_DIFFERENCE = 1e-5
_LEAST_CURVATURE = 1e-6
"""share of the mean diagonal that every direction has at least: the data may not see all of them"""

_MEMORY = 0.9
"""of the curvature, from step to step: what a step may change falls as batches agree, and the
last ones are averaged over ten"""

_FIRST_DAMPING, _LEAST_DAMPING = 0.1, 1e-4
_EASE, _STIFFEN = 3.0, 4.0
_TRIES = 6


class Trust(NamedTuple):
    """What one step leaves to the next."""

    damping: float
    """share of the curvature's diagonal that is added to it"""
    curvature: Array
    """(P, P) products of the Jacobians so far, fading"""


def log_error_of(errors: Array) -> float:
    """Mean over the states of log(mean squared error); infinite where an error is not finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        squares = np.mean(np.square(errors), axis=(0, 1))
    return float(np.log(squares).mean()) if np.all(np.isfinite(squares)) else np.inf


def begin(parameters: int) -> Trust:
    """The trust of the first step."""
    return Trust(_FIRST_DAMPING, np.zeros((parameters, parameters)))


def step(theta: Array, residuals: Residuals, judged: Judged, trust: Trust) -> tuple[Array, Trust]:
    """The next theta (P,), and the trust to go on with; theta itself if no step is a gain.

    `residuals` may be of a few windows, drawn anew for each step. Whether it is a gain is for
    `judged` to say, always of the same many: a step that suits the few alone is not taken.
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
    diagonal = np.diag(curvature) + _LEAST_CURVATURE * np.trace(curvature) / len(theta)
    before, damping = judged(theta), trust.damping
    for _ in range(_TRIES):
        matrix = curvature + np.diag(damping * diagonal)
        candidate = theta - scipy.linalg.solve(matrix, gradient, assume_a="pos")
        if judged(candidate) < before:
            return candidate, Trust(max(damping / _EASE, _LEAST_DAMPING), curvature)
        damping *= _STIFFEN
    return theta, Trust(_STIFFEN * trust.damping, curvature)
