"""Keeping the spectral radius at 1 by putting eigenvalues back, not by a penalty.

yaw rate -> heading error -> lateral error is a Jordan block at 1, where eigenvalues are as
sensitive as they can be: the gradient of a penalty on them has no bound there, and a bound on the
norm of A would forbid the true model. In Schur form an eigenvalue can be moved without touching
the others.
"""

import numpy as np
import scipy.linalg
import torch
from numpy.typing import NDArray

from offline.model import MdkNet

Array = NDArray[np.float64]

_NO_COUPLING = 1e-12


def with_bounded_spectrum(A: Array, bound: float = 1.0) -> Array:
    """The matrix (n, n) with each eigenvalue beyond `bound` scaled back to it."""
    T, Q = scipy.linalg.schur(A, output="real")
    moved = False
    i, n = 0, len(A)
    while i < n:
        is_pair = i + 1 < n and abs(T[i + 1, i]) > _NO_COUPLING
        block = T[i : i + 1 + is_pair, i : i + 1 + is_pair]
        magnitude = float(np.max(np.abs(np.linalg.eigvals(block))))
        if magnitude > bound:
            block *= bound / magnitude
            moved = True
        i += 1 + is_pair
    return np.asarray(Q @ T @ Q.T) if moved else A


def project(model: MdkNet) -> None:
    """Bound the spectrum of the model's A in place.

    A constant observable's row is left out: A is block triangular with it, and its own eigenvalue
    is 1 exactly.
    """
    rows = len(model.A_rows)
    with torch.no_grad():
        A = model.A_rows[:, :rows].double().cpu().numpy()
        if np.all(np.isfinite(A)):  # else the loss is no number either, and says so
            model.A_rows[:, :rows] = torch.from_numpy(with_bounded_spectrum(A))
