"""The part of the motion that depends neither on the inputs nor linearly on the lifted state."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array

NO_SIGNAL = -1
"""in place of a column; the last one of [w, 1]"""


class Drift(NamedTuple):
    """What is added to A psi + B u: sum_r N[:, r] t_r, with a_r = S[r] @ psi + s0[r].

    - t = tanh(a) - a, where there is no exogenous signal. It is zero with its slope at a = 0, so A
      describes a motion that is small in S psi; far from it the part N a of A psi saturates, as the
      force of a tyre does beyond its limit.
    - t = tanh(a) w, for an exogenous signal w. A road of curvature kappa turns the heading error by
      kappa times the speed, and the speed changes.
    """

    N: Array
    """(n, D)"""
    S: Array
    """(D, n)"""
    s0: Array
    """(D,)"""
    signal: NDArray[np.int64]
    """(D,) column of the exogenous signal, or `NO_SIGNAL`"""

    @property
    def rank(self) -> int:
        return int(self.s0.shape[0])

    @property
    def is_saturation(self) -> NDArray[np.bool_]:
        """(D,) True where t = tanh(a) - a."""
        return np.asarray(self.signal == NO_SIGNAL)

    def factors(self, w: Array) -> Array:
        """What tanh(a) is multiplied by (..., D): an exogenous signal of w (..., p), or 1."""
        ones = np.ones((*w.shape[:-1], 1))
        return np.asarray(np.concatenate((w, ones), axis=-1)[..., self.signal])

    def terms(self, psi: Array, w: Array) -> Array:
        """t (..., D) at psi (..., n), with the exogenous signals w (..., p)."""
        a = psi @ self.S.T + self.s0
        return np.asarray(np.tanh(a) * self.factors(w) - a * self.is_saturation)


def no_drift(n: int) -> Drift:
    """That of a model of n observables without one."""
    return Drift(np.zeros((n, 0)), np.zeros((0, n)), np.zeros(0), np.zeros(0, dtype=np.int64))
