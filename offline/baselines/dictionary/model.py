"""A model that is linear or bilinear in a fixed dictionary: DMDc with delays and all of EDMDc.

psi = [x; rows of the past; functions of x and w; 1] in scaled signals, lifted once, and

    psi_(k+1) = A psi_k + B_uc u_k + B_uw w_k + sum_r N_r (psi_g(r) u_k),

where the last sum is part of bilinear models only; `Follow` says from which psi its factors are.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from offline.baselines.dictionary.functions import Family, Functions
from offline.baselines.window_shape import require_windows
from offline.data.signals import Scaling, last_rows
from rt_controller.contract.arrays import Array
from rt_controller.contract.model.bundle import spectral_radius_of
from rt_controller.contract.model.rollout import Matrices, roll_out
from rt_controller.report.table import Fact


class Dictionary(NamedTuple):
    """The observables psi of signals in physical units."""

    functions: Functions
    scaling: Scaling
    past_steps: int = 0
    """rows of the past in psi"""
    gains: tuple[int, ...] = ()
    """entries of psi that the inputs are multiplied by"""

    def lift(self, x: Array, w: Array, past: Array) -> Array:
        """psi (..., n) of states (..., n_x), w (..., p) and past (..., H, h), H >= past_steps."""
        scaling = self.scaling
        x = scaling.normalise_states(x)
        parts = [x]
        if self.past_steps:
            last = (last_rows(past, self.past_steps) - scaling.past_centre) / scaling.past_scale
            parts.append(last.reshape(*x.shape[:-1], -1))
        parts.append(self.functions.evaluate(np.concatenate([x, w / scaling.w_scale], axis=-1)))
        return np.concatenate([*parts, np.ones((*x.shape[:-1], 1))], axis=-1)

    def regressors(self, psi: Array, u: Array, w: Array) -> Array:
        """[psi, u, w, u times each gain] (..., r); psi (..., n), scaled u (..., m), w (..., p)."""
        products = psi[..., self.gains, None] * u[..., None, :]
        return np.concatenate([psi, u, w, products.reshape(*u.shape[:-1], -1)], axis=-1)


@dataclass(frozen=True, slots=True)
class LiftedModel:
    """A dictionary and the dynamics of its observables."""

    dictionary: Dictionary
    matrices: Matrices
    """of psi and scaled signals; c is zero, since psi ends with 1"""
    ridge: float
    """that the matrices were fitted with"""

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n_x), as `Predictor.predict`."""
        scaling, past_steps = self.dictionary.scaling, self.dictionary.past_steps
        n_x, past_signals = len(scaling.x_scale), len(scaling.past_scale) if past_steps else 0
        signals = (n_x, len(scaling.u_scale), len(scaling.w_scale))
        require_windows(x0, past, U, W, signals, past_signals, past_steps)
        psi0 = self.dictionary.lift(x0, W[:, 0], past)
        with np.errstate(over="ignore", invalid="ignore"):
            scaled = roll_out(self.matrices, psi0, U / scaling.u_scale, W / scaling.w_scale, n_x)
        states = scaled * scaling.x_scale + scaling.x_centre
        states[:, 0] = x0
        return states

    def fit_info(self) -> tuple[Fact, ...]:
        """Size and kind of the dictionary, and the ridge."""
        functions, bilinear = self.dictionary.functions, self.matrices.bilinear
        radius = spectral_radius_of(self.matrices.A)
        facts = [
            Fact("observables", str(len(self.matrices.A))),
            Fact("past periods", str(self.dictionary.past_steps)),
            Fact("functions", f"{len(functions.rows)} {functions.family}"),
            Fact("ridge", f"{self.ridge:g}"),
            Fact("spectral radius", f"{radius:.5f}"),
        ]
        if functions.family in (Family.GAUSSIANS, Family.COSINES):
            facts.append(Fact("width", f"{functions.width:.3g}"))
        if bilinear is not None:
            facts.append(Fact("gains", f"{bilinear.rank}, following the {bilinear.follows}"))
        return tuple(facts)
