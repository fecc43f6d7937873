"""Prediction with a lifted model in numpy: the terms of its right-hand side, one step, a roll-out.

Everything that runs a finished model uses these: controller, evaluation and linear baselines.
"""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array
from rt_controller.model.follow import Follow


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


def no_drift(n: int) -> Drift:
    """That of a model of n observables without one."""
    return Drift(np.zeros((n, 0)), np.zeros((0, n)), np.zeros(0), np.zeros(0, dtype=np.int64))


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


class Dynamics(Protocol):
    """What has the matrices of a model: `Matrices`, or a bundle."""

    @property
    def A(self) -> Array: ...
    @property
    def B_uc(self) -> Array: ...
    @property
    def B_uw(self) -> Array: ...
    @property
    def c(self) -> Array: ...
    @property
    def bilinear(self) -> Bilinear | None: ...
    @property
    def drift(self) -> Drift | None: ...


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
    return Step(model)(psi, np.concatenate((u, w, np.ones((*u.shape[:-1], 1))), axis=-1))


def roll_out(model: Dynamics, psi0: Array, U: Array, W: Array, outputs: int) -> Array:
    """The first `outputs` observables (batch, K+1, outputs), those of psi0 (batch, n) first.

    U (batch, K, m) and W (batch, K, p) are held over each step. Input matrix and drift follow the
    lifted state that `Bilinear.follows` names; without a bilinear part, the predicted one.
    Paper: eqs. (6)-(8).
    """
    follow = Follow.PREDICTION if model.bilinear is None else model.bilinear.follows
    found = np.empty((len(psi0), U.shape[1] + 1, outputs))
    found[:, 0] = psi0[:, :outputs]
    step, psi = Step(model), psi0
    inputs = np.concatenate((U, W, np.ones((*U.shape[:-1], 1))), axis=-1)
    followed = None if follow is Follow.PREDICTION else psi0
    for k in range(U.shape[1]):
        psi = step(psi, inputs[:, k], followed)
        found[:, k + 1] = psi[:, :outputs]
        if followed is not None and follow is Follow.FREE_RESPONSE:
            followed = followed @ model.A.T + W[:, k] @ model.B_uw.T + model.c
    return found
