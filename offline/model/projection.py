"""Bounds the spectral radius of A by moving eigenvalues back to the unit circle.

Yaw rate -> heading error -> lateral error is a Jordan block at 1. There the gradient of a penalty
on eigenvalues is unbounded, and a bound on the norm of A would exclude the true model. In the
Schur form an eigenvalue is moved without changing the others.
"""

import numpy as np
import scipy.linalg
import torch

from offline.model.network import MdkNet
from rt_controller.contract.arrays import Array
from rt_controller.contract.model.bundle import spectral_radius_of

_NO_COUPLING = 1e-12


def with_bounded_spectrum(A: Array, bound: float = 1.0) -> Array:
    """The matrix (n, n) with each eigenvalue of magnitude above `bound` scaled back to it."""
    T, Q = scipy.linalg.schur(A, output="real")
    moved = False
    i, n = 0, len(A)
    while i < n:
        is_pair = i + 1 < n and abs(T[i + 1, i]) > _NO_COUPLING
        block = T[i : i + 1 + is_pair, i : i + 1 + is_pair]
        magnitude = spectral_radius_of(block)
        if magnitude > bound:
            block *= bound / magnitude
            moved = True
        i += 1 + is_pair
    return np.asarray(Q @ T @ Q.T) if moved else A


def project(model: MdkNet) -> None:
    """Bound the spectrum of the model's A in place; leave an A that is not finite unchanged.

    The row of a constant observable is left out: A is block triangular with it, and its eigenvalue
    is exactly 1.
    """
    rows = len(model.A_rows)
    with torch.no_grad():
        A = model.A_rows[:, :rows].double().cpu().numpy()
        if np.all(np.isfinite(A)):
            model.A_rows[:, :rows] = torch.from_numpy(with_bounded_spectrum(A))


def spectral_radius(model: MdkNet) -> float:
    """Largest magnitude of an eigenvalue of A, in float64; NaN if A is not finite."""
    A = model.operator().A.detach().double().cpu().numpy()
    if not np.all(np.isfinite(A)):
        return float("nan")
    return spectral_radius_of(A)
