"""Prediction with a lifted model: one step, and a whole roll-out, in numpy.

Everything that runs a finished model uses these: controller, evaluation and linear baselines.
"""

from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.model.bilinear import Bilinear
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.model.drift import Drift
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


def one_step(model: Dynamics, psi: Array, followed: Array, u: Array, w: Array) -> Array:
    """psi_(k+1) (..., n) from psi (..., n), inputs u (..., m) and exogenous signals w (..., p).

    Input matrix and drift are those of the lifted states `followed` (..., n).
    Paper: eq. (8).
    """
    following: Array = psi @ model.A.T + u @ model.B_uc.T + (w @ model.B_uw.T + model.c)
    if model.bilinear is not None:
        # B_eff u without forming B_eff: N has one column for each of R m products gain * input.
        N = model.bilinear.N
        products = model.bilinear.gains(followed) * u[..., None, :]
        columns = N.transpose(0, 2, 1).reshape(-1, N.shape[1])
        following += products.reshape(*psi.shape[:-1], -1) @ columns
    if model.drift is not None:
        following += model.drift.terms(followed, w) @ model.drift.N.T
    return following


def roll_out(model: Dynamics, psi0: Array, U: Array, W: Array, outputs: int) -> Array:
    """The first `outputs` observables (batch, K+1, outputs), those of psi0 (batch, n) first.

    U (batch, K, m) and W (batch, K, p) are held over each step. Input matrix and drift follow the
    lifted state that `Bilinear.follows` names; without a bilinear part, the predicted one.
    Paper: eqs. (6)-(8).
    """
    follow = Follow.PREDICTION if model.bilinear is None else model.bilinear.follows
    found = np.empty((len(psi0), U.shape[1] + 1, outputs))
    found[:, 0] = psi0[:, :outputs]
    psi = followed = psi0
    for k in range(U.shape[1]):
        psi = one_step(model, psi, followed, U[:, k], W[:, k])
        found[:, k + 1] = psi[:, :outputs]
        if follow is Follow.PREDICTION:
            followed = psi
        elif follow is Follow.FREE_RESPONSE:
            followed = followed @ model.A.T + W[:, k] @ model.B_uw.T + model.c
    return found
