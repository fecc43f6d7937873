"""An input matrix that depends on the lifted state, with few parameters."""

from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.model.follow import Follow


class Bilinear(NamedTuple):
    """The part of each column of the input matrix that depends on the lifted state.

    In a bilinear Koopman model input i acts through (b_i + N_i psi) u_i. Here every matrix N_i has
    rank R, N_i psi = sum_r N[r, :, i] (S[r, i] @ psi), with an offset s0[r, i] on each factor:
    B_eff[:, i] = B_uc[:, i] + sum_r N[r, :, i] * (S[r, i] @ psi + s0[r, i]).

    With `saturates`, each factor is the hyperbolic tangent of that: then B_eff is bounded for every
    lifted state, as the forces of tyres and engine are.

    Paper: conclusion, where bilinear models are named as future work.
    """

    N: Array
    """(R, n, m), the directions in which input i acts"""
    S: Array
    """(R, m, n), the share of each direction, linear in the lifted state"""
    s0: Array
    """(R, m)"""
    follows: Follow = Follow.PREDICTION
    """the psi that is used in a prediction"""
    saturates: bool = False

    @property
    def rank(self) -> int:
        return int(self.s0.shape[0])

    def gains(self, psi: Array) -> Array:
        """The share of each direction at psi (..., n): (..., R, m)."""
        flat: Array = psi @ self.S.reshape(-1, self.S.shape[2]).T
        shares: Array = flat.reshape(*psi.shape[:-1], *self.s0.shape) + self.s0
        return np.tanh(shares, out=shares) if self.saturates else shares
