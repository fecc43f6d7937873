"""A model that is linear, or bilinear, in a fixed dictionary: DMDc with delays and all of EDMDc.

psi = [x; rows of the past; functions of x and w; 1], in units of each signal's spread, and

    psi_(k+1) = A psi_k + B_uc u_k + B_uw w_k + sum_r N_r (psi_g(r) u_k)

where the last sum is there for bilinear models only. What its factors psi_g(r) follow is a choice
of its own (`Follow`). Lifted once, at the start, like every model here.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from offline.baselines.finding import Finding
from offline.baselines.functions import Family, Functions
from offline.baselines.window_shape import WindowShape
from rt_controller.contract.follow import Follow

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LiftedModel:
    """The dictionary, the operator, and the scales both work in."""

    family: str
    rows: Array
    shifts: Array
    width: float
    """these four are the `Functions` of the dictionary"""
    past_steps: int
    """rows of the past in psi"""
    x_centre: Array
    """(n_x,)"""
    x_scale: Array
    """(n_x,)"""
    u_scale: Array
    """(m,)"""
    w_scale: Array
    """(p,)"""
    past_centre: Array
    """(h,)"""
    past_scale: Array
    """(h,)"""
    A: Array
    """(n, n)"""
    B_uc: Array
    """(n, m)"""
    B_uw: Array
    """(n, p)"""
    gains: NDArray[np.int64]
    """(R,) which entries of psi the inputs are multiplied by"""
    N: Array
    """(n, R * m), gain by gain"""
    follow: str
    """what these entries are read from, a `Follow`"""
    ridge: float
    """that the operator was found with"""

    @property
    def functions(self) -> Functions:
        """The non-linear part of the dictionary."""
        return Functions(Family(self.family), self.rows, self.shifts, self.width)

    def lift(self, x: Array, w: Array, past: Array) -> Array:
        """psi (..., n) of states (..., n_x), w (..., p) and past (..., H, h), H >= past_steps."""
        x = (x - self.x_centre) / self.x_scale
        parts = [x]
        if self.past_steps:
            last = past[..., past.shape[-2] - self.past_steps :, :]
            last = (last - self.past_centre) / self.past_scale
            parts.append(last.reshape(*x.shape[:-1], -1))
        parts.append(self.functions.evaluate(np.concatenate([x, w / self.w_scale], axis=-1)))
        return np.concatenate([*parts, np.ones((*x.shape[:-1], 1))], axis=-1)

    def regressors(self, psi: Array, u: Array, w: Array, factors: Array) -> Array:
        """[psi, u, w, u times each factor] (..., r), all scaled; factors (..., R) are gains."""
        products = factors[..., :, None] * u[..., None, :]
        return np.concatenate([psi, u, w, products.reshape(*u.shape[:-1], -1)], axis=-1)

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n_x).

        Raises:
            DatasetError: the shapes are not those of the data it was fitted to.
        """
        n_x, remembered = len(self.x_scale), len(self.past_scale) if self.past_steps else 0
        WindowShape(n_x, len(self.u_scale), len(self.w_scale), remembered, self.past_steps).require(
            x0, past, U, W
        )
        operator = np.concatenate([self.A, self.B_uc, self.B_uw, self.N], axis=1).T
        psi = self.lift(x0, W[:, 0], past)
        follow, read_from = Follow(self.follow), psi
        scaled = np.empty((len(x0), U.shape[1] + 1, n_x))
        scaled[:, 0] = psi[:, :n_x]
        with np.errstate(over="ignore", invalid="ignore"):
            for k in range(U.shape[1]):
                factors = read_from[:, self.gains]
                u, w = U[:, k] / self.u_scale, W[:, k] / self.w_scale
                psi = self.regressors(psi, u, w, factors) @ operator
                scaled[:, k + 1] = psi[:, :n_x]
                if follow is Follow.PREDICTION:
                    read_from = psi
                elif follow is Follow.FREE_RESPONSE:
                    read_from = read_from @ self.A.T + w @ self.B_uw.T
        states = scaled * self.x_scale + self.x_centre
        states[:, 0] = x0
        return states

    def findings(self) -> tuple[Finding, ...]:
        """Size and make of the dictionary, and the ridge."""
        radius = np.max(np.abs(np.linalg.eigvals(self.A)))
        found = [
            Finding("observables", str(len(self.A))),
            Finding("past periods", str(self.past_steps)),
            Finding("functions", f"{len(self.rows)} {self.family}"),
            Finding("ridge", f"{self.ridge:g}"),
            Finding("spectral radius", f"{radius:.5f}"),
        ]
        if self.family in (Family.GAUSSIANS, Family.COSINES):
            found.append(Finding("width", f"{self.width:.3g}"))
        if len(self.gains):
            found.append(Finding("gains", f"{len(self.gains)}, following the {self.follow}"))
        return tuple(found)
