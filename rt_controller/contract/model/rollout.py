"""Prediction with a lifted model: one step, and a whole roll-out, in numpy.

Everything that runs a finished model uses these: controller, evaluation and linear baselines.
"""

from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.model.bilinear import Bilinear
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.model.drift import Drift, no_drift
from rt_controller.contract.model.follow import Follow


class Matrices(NamedTuple):
    """psi_(k+1) = A psi_k + B_eff u_k + B_uw w_k + c + drift, without encoder and signals.

    A (n, n), B_uc (n, m), B_uw (n, p), c (n,); B_eff = B_uc without a bilinear part.
    """

    A: Array
    B_uc: Array
    B_uw: Array
    c: Array
    bilinear: Bilinear | None = None
    drift: Drift | None = None


Dynamics = Bundle | Matrices


class Step:
    """One step of a model of n observables, m inputs and p signals, its matrices arranged once.

    Each of the q gains, those of the inputs and then those of the drift, is a function of one
    number a = S psi + s0. With t = tanh(a), or a where the gain does not saturate, N (t f - a o) is
    added, where f is what the gain is multiplied by (a column of [u; w; 1]), and o is 1 for a
    saturation tanh(a) - a.

    Paper: eq. (8).
    """

    def __init__(self, model: Dynamics) -> None:
        (n, m), p = model.B_uc.shape, model.B_uw.shape[1]
        bilinear, drift = model.bilinear, model.drift or no_drift(n)
        S, s0, N, of_inputs = [drift.S], [drift.s0], [drift.N], 0
        self.first_saturating = 0
        if bilinear is not None:
            S.insert(0, bilinear.S.reshape(-1, n))
            s0.insert(0, bilinear.s0.reshape(-1))
            N.insert(0, bilinear.N.transpose(1, 0, 2).reshape(n, -1))
            of_inputs = bilinear.s0.size
            self.first_saturating = 0 if bilinear.saturates else of_inputs
        self.S, self.s0, self.N = np.concatenate(S), np.concatenate(s0), np.concatenate(N, axis=1)
        """(q, n), (q,) and (n, q)"""
        self.count = len(self.s0)
        of_drift = np.where(drift.is_saturation, p, drift.signal) + m
        self.factors = np.concatenate((np.arange(of_inputs) % m, of_drift))
        """(q,), columns of [u; w; 1]"""
        self.is_saturation: Array = np.concatenate((np.zeros(of_inputs), drift.is_saturation))
        self.has_saturation = bool(self.is_saturation.any())
        self._by_psi = np.ascontiguousarray(np.vstack((model.A, self.S)).T)
        forcing = np.hstack((model.B_uc, model.B_uw, np.reshape(model.c, (n, 1))))
        self._by_inputs = np.hstack((forcing.T, np.zeros((m + p + 1, self.count))))
        self._by_inputs[-1, n:] = self.s0
        self._N_T = np.ascontiguousarray(self.N.T)

    def __call__(self, psi: Array, inputs: Array, followed: Array | None = None) -> Array:
        """psi_(k+1) (..., n) from psi (..., n) and inputs [u; w; 1] (..., m + p + 1).

        Input matrix and drift are those of the lifted states `followed` (..., n); None: of psi.
        """
        mapped: Array = psi @ self._by_psi + inputs @ self._by_inputs
        if self.count == 0:
            return mapped
        a = mapped[..., -self.count :] if followed is None else followed @ self.S.T + self.s0
        t = np.array(a)
        saturating = t[..., self.first_saturating :]
        np.tanh(saturating, out=saturating)
        t *= inputs[..., self.factors]
        if self.has_saturation:
            t -= a * self.is_saturation
        following: Array = mapped[..., : -self.count]
        following += t @ self._N_T
        return following


def one_step(model: Dynamics, psi: Array, u: Array, w: Array) -> Array:
    """psi_(k+1) (..., n) from psi (..., n), inputs u (..., m) and exogenous signals w (..., p)."""
    return Step(model)(psi, with_one(u, w))


def with_one(u: Array, w: Array) -> Array:
    """[u; w; 1] (..., m + p + 1)."""
    return np.asarray(np.concatenate((u, w, np.ones((*u.shape[:-1], 1))), axis=-1))


def roll_out(model: Dynamics, psi0: Array, U: Array, W: Array, outputs: int) -> Array:
    """The first `outputs` observables (batch, K+1, outputs), those of psi0 (batch, n) first.

    U (batch, K, m) and W (batch, K, p) are held over each step. Input matrix and drift follow the
    lifted state that `Bilinear.follows` names; without a bilinear part, the predicted one.
    Paper: eqs. (6)-(8).
    """
    follow = Follow.PREDICTION if model.bilinear is None else model.bilinear.follows
    found = np.empty((len(psi0), U.shape[1] + 1, outputs))
    found[:, 0] = psi0[:, :outputs]
    step, inputs, psi = Step(model), with_one(U, W), psi0
    followed = None if follow is Follow.PREDICTION else psi0
    for k in range(U.shape[1]):
        psi = step(psi, inputs[:, k], followed)
        found[:, k + 1] = psi[:, :outputs]
        if followed is not None and follow is Follow.FREE_RESPONSE:
            followed = followed @ model.A.T + W[:, k] @ model.B_uw.T + model.c
    return found
