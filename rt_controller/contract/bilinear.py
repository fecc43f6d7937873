"""An input matrix that depends on where the car is, in few numbers."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.follow import Follow

Array = NDArray[np.float64]


class Bilinear(NamedTuple):
    """What the lifted state adds to each column of the constant input matrix B_uc.

    In a bilinear Koopman model input i acts through (b_i + N_i psi) u_i. Here every matrix N_i has
    rank R, N_i psi = sum_r N[r, :, i] (S[r, i] @ psi), with an offset s0[r, i] on each factor:
    B_eff[:, i] = B_uc[:, i] + sum_r N[r, :, i] * (S[r, i] @ psi + s0[r, i]).

    Paper: conclusion, where bilinear models are named as future work.
    """

    N: Array
    """(R, n, m), the directions in which input i acts"""
    S: Array
    """(R, m, n), how much of each, read from the lifted state"""
    s0: Array
    """(R, m)"""
    follows: Follow = Follow.PREDICTION
    """which psi that is"""

    @property
    def rank(self) -> int:
        return int(self.s0.shape[0])

    def gains(self, psi: Array) -> Array:
        """How much of each direction there is at psi (..., n): (..., R, m)."""
        gains: Array = np.einsum("rin,...n->...ri", self.S, psi) + self.s0
        return gains

    def added_columns(self, psi: Array) -> Array:
        """B_eff - B_uc at psi (..., n): (..., n, m)."""
        columns: Array = np.einsum("rni,...ri->...ni", self.N, self.gains(psi))
        return columns
