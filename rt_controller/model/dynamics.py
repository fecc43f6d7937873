"""Prediction with a lifted model in numpy: the terms of its right-hand side, one step, a roll-out.

Everything that runs a finished model uses these: controller, evaluation and linear baselines.
"""

from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import PATH_STATES
from rt_controller.model.follow import Follow
from rt_controller.model.path_kinematics import Movement, path_after, path_of, path_of_one

if TYPE_CHECKING:
    from rt_controller.model.bundle import Bundle


class Shape(IntEnum):
    """The function t = g(a) of a gain, in the order in which a model has its gains."""

    LINEAR = 0
    """t = a"""
    TANH = 1
    """t = tanh(a), which is bounded as the forces of tyres and engine are"""
    SATURATION = 2
    """t = tanh(a) - a: zero with its slope at a = 0, so A describes a motion that is small in
    S psi; far from it the part N a of A psi saturates, as the force of a tyre beyond its limit"""


class Gains(NamedTuple):
    """The terms of a model that are not linear: q products of a function of psi and a factor.

    psi+ = A psi + B_uc u + B_uw w + c + sum_r N[:, r] g_r(a_r) f_r, with a_r = S[r] @ psi + s0[r].

    The factor f_r is an input (then B_uc depends on the lifted state, as in a bilinear Koopman
    model), an exogenous signal (a road of curvature kappa turns the heading error by kappa times
    the speed, and the speed changes), or 1 (saturation of the motion without inputs).

    A variant of the model is another list of such terms: everything that predicts with a model
    reads this list.

    Paper: conclusion, where bilinear models are named as future work.
    """

    N: Array
    """(n, q)"""
    S: Array
    """(q, n)"""
    s0: Array
    """(q,)"""
    factor: NDArray[np.int64]
    """(q,) column of [u; w; 1]"""
    shape: NDArray[np.int64]
    """(q,) `Shape` of each, ascending; a `SATURATION` has the factor 1"""
    follows: Follow = Follow.PREDICTION
    """the psi that is used in a prediction"""

    def factors(self, u: Array, w: Array) -> Array:
        """The factor of each gain (..., q) under inputs u (..., m) and signals w (..., p)."""
        ones = np.ones((*u.shape[:-1], 1))
        return np.asarray(np.concatenate((u, w, ones), axis=-1)[..., self.factor])


def no_gains(n: int) -> Gains:
    """Those of a linear model of n observables."""
    none = np.zeros(0, dtype=np.int64)
    return Gains(np.zeros((n, 0)), np.zeros((0, n)), np.zeros(0), none, none)


class Matrices(NamedTuple):
    """psi_(k+1) = A psi_k + B_uc u_k + B_uw w_k + c + gains, without encoder and signals.

    A (n, n), B_uc (n, m), B_uw (n, p), c (n,).
    """

    A: Array
    B_uc: Array
    B_uw: Array
    c: Array
    gains: Gains | None = None
    """None: the model is linear in psi"""
    movement: Movement | None = None
    """that the path states follow from by kinematics, their rows above being zero; None: they are
    predicted as all other observables"""


Dynamics: TypeAlias = "Matrices | Bundle"
"""what has the matrices of a model"""


class Step:
    """One step of a model of n observables, m inputs and p signals, its matrices arranged once.

        psi+ = A psi + B [u; w] + c + N (t f),  t = tanh(S psi + s0), or S psi + s0 if it is linear

    with the factor f of each gain. The linear part of a saturation tanh(a) - a belongs to A and c.

    Paper: eq. (8).
    """

    def __init__(self, model: Dynamics) -> None:
        (n, m), p = model.B_uc.shape, model.B_uw.shape[1]
        gains = model.gains or no_gains(n)
        self.N, self.S, self.s0, self.factors = gains[:4]
        self.count = len(self.s0)
        self.first_saturating = int(np.count_nonzero(gains.shape == Shape.LINEAR))
        """index of the first gain whose t is a hyperbolic tangent"""
        self._subtracted = self.N * (gains.shape == Shape.SATURATION)
        self.A: Array = model.A - self._subtracted @ self.S
        self.c: Array = model.c - self._subtracted @ self.s0
        self.B: Array = np.hstack((model.B_uc, model.B_uw))
        self._by_psi = np.ascontiguousarray(np.vstack((self.A, self.S)).T)
        self._movement, self._curvature = model.movement, m
        self._by_inputs = np.zeros((m + p + 1, n + self.count))
        self._by_inputs[:-1, :n], self._by_inputs[-1] = self.B.T, np.append(self.c, self.s0)
        self._N_T = np.ascontiguousarray(self.N.T)

    def __call__(self, psi: Array, inputs: Array, followed: Array | None = None) -> Array:
        """psi_(k+1) (..., n) from psi (..., n) and inputs [u; w; 1] (..., m + p + 1).

        The gains are those of the lifted states `followed` (..., n); None: of psi.
        """
        following = self._without_path(psi, inputs, followed)
        if self._movement is not None:
            moved, path = psi @ self._movement.S.T + self._movement.s0, psi[..., PATH_STATES]
            curvature = inputs[..., self._curvature]
            if psi.ndim == 1:
                following[PATH_STATES] = path_of_one(moved, float(curvature), path)
            else:
                following[..., PATH_STATES] = path_after(moved, curvature, path)
        return following

    def along(self, inputs: Array, psi: Array) -> Array:
        """Predict lifted states psi (K + 1, n) in place, from psi[0]; returns the t (K, q).

        `inputs` [u; w; 1] (K, m + p + 1), with a constant curvature of the road.
        """
        n, first = psi.shape[1], self.first_saturating
        forcing, factors = inputs @ self._by_inputs, inputs[:, self.factors]
        t = np.empty(factors.shape)
        # Calls of numpy are what this loop costs.
        for now, after, forced, t_k, f_k in zip(
            psi[:-1], psi[1:], forcing, t, factors, strict=True
        ):
            mapped = np.dot(now, self._by_psi)
            mapped += forced
            if not self.count:
                after[:] = mapped
                continue
            t_k[:first] = mapped[n : n + first]
            np.tanh(mapped[n + first :], out=t_k[first:])
            np.add(np.dot(t_k * f_k, self._N_T), mapped[:n], out=after)
        if self._movement is not None:
            moved, path = psi[:-1] @ self._movement.S.T + self._movement.s0, psi[0, PATH_STATES]
            psi[1:, PATH_STATES] = path_of(moved, float(inputs[0, self._curvature]), path)
        return t

    def _without_path(self, psi: Array, inputs: Array, followed: Array | None) -> Array:
        mapped: Array = psi @ self._by_psi + inputs @ self._by_inputs
        if self.count == 0:
            return mapped
        a, following = mapped[..., -self.count :], mapped[..., : -self.count]
        if followed is not None:
            of_psi, a = a, followed @ self.S.T + self.s0
            following += (of_psi - a) @ self._subtracted.T
        following += (self.values(a) * inputs[..., self.factors]) @ self._N_T
        return following

    def values(self, a: Array) -> Array:
        """t (..., q) of the gains, from their arguments a (..., q), which are overwritten."""
        saturating = a[..., self.first_saturating :]
        np.tanh(saturating, out=saturating)
        return a


def roll_out(model: Dynamics, psi0: Array, U: Array, W: Array, outputs: int) -> Array:
    """The first `outputs` observables (batch, K+1, outputs), those of psi0 (batch, n) first.

    U (batch, K, m) and W (batch, K, p) are held over each step. The gains follow the lifted state
    that `Gains.follows` names.
    Paper: eqs. (6)-(8).
    """
    follow = Follow.PREDICTION if model.gains is None else model.gains.follows
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
