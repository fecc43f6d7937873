"""A linear model of the physical states, with offset: what every LTI rival ends as."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from offline.baselines.finding import Finding
from offline.baselines.window_shape import WindowShape

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LinearModel:
    """x_(k+1) = A x_k + B_uc u_k + B_uw w_k + c in physical units."""

    A: Array
    """(n, n)"""
    B_uc: Array
    """(n, m)"""
    B_uw: Array
    """(n, p)"""
    c: Array
    """(n,)"""

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n); the past is not looked at.

        Raises:
            DatasetError: the shapes are not those of the data it was fitted to.
        """
        WindowShape(len(self.A), self.B_uc.shape[1], self.B_uw.shape[1]).require(x0, past, U, W)
        driven = U @ self.B_uc.T + W @ self.B_uw.T + self.c
        states = np.empty((len(x0), U.shape[1] + 1, len(self.A)))
        states[:, 0] = x0
        for k in range(U.shape[1]):
            states[:, k + 1] = states[:, k] @ self.A.T + driven[:, k]
        return states

    def findings(self) -> tuple[Finding, ...]:
        """Largest eigenvalue, which says whether predictions may grow."""
        radius = np.max(np.abs(np.linalg.eigvals(self.A)))
        return (Finding("spectral radius", f"{radius:.5f}"),)
