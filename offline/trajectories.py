"""Two seconds of driving, many times: what models learn from and are judged on."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array32 = NDArray[np.float32]
Rows = NDArray[np.integer] | NDArray[np.bool_] | slice


class Trajectories(NamedTuple):
    """Trajectories of equal length in physical units, with what happened right before them."""

    x: Array32
    """(N, K+1, n) states"""
    u: Array32
    """(N, K, m) inputs, each held from the state of its step to the next"""
    w: Array32
    """(N, K, p) exogenous signals, the same way"""
    past: Array32
    """(N, H, h) the H steps before, oldest first: some states, and the inputs that followed them"""
    episode: NDArray[np.int32]
    """(N,) the number of the episode a trajectory was cut from"""

    def take(self, rows: Rows) -> "Trajectories":
        """The trajectories of these rows."""
        x, u, w, past, episode = self
        return Trajectories(x[rows], u[rows], w[rows], past[rows], episode[rows])
