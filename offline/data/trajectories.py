"""Trajectories of equal length, for training and evaluation."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array32 = NDArray[np.float32]
Rows = NDArray[np.integer] | NDArray[np.bool_] | slice


class Trajectories(NamedTuple):
    """N trajectories of K steps in physical units, with the H steps before each."""

    x: Array32
    """(N, K+1, n) states"""
    u: Array32
    """(N, K, m) inputs, each held from the state of its step to the next"""
    w: Array32
    """(N, K, p) exogenous signals, held likewise"""
    past: Array32
    """(N, H, h) rows of the history, oldest first: states, and the inputs held after them"""
    episode: NDArray[np.int32]
    """(N,) number of the episode"""
    conditions: Array32 | None = None
    """(N, K, q) as in `Recording`"""

    def take(self, rows: Rows) -> "Trajectories":
        """The trajectories of these rows."""
        x, u, w, past, episode, conditions = self
        taken = None if conditions is None else conditions[rows]
        return Trajectories(x[rows], u[rows], w[rows], past[rows], episode[rows], taken)
