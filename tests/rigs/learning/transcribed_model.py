"""One step of the network written out, gain by gain."""

import torch
from torch import Tensor

from offline.model.network import MdkNet
from rt_controller.model.dynamics import NO_SIGNAL, Follow


def step(model: MdkNet, psi: Tensor, followed: Tensor, u: Tensor, w: Tensor) -> Tensor:
    """psi_(k+1) (n,): A psi + (B_i + sum_r N_ri g(S_ri psi')) u_i + B_w w + drift at psi'.

    g is the hyperbolic tangent if the gains saturate. psi' is `followed` (n,); u (m,), w (p,).
    """
    A, B = model.operator()
    S, N = model.gains()
    m = model.sizes.inputs
    after = A @ psi + B[:, m:] @ w
    for i in range(m):
        column = B[:, i]
        for r in range(model.rank):
            share = S[r * m + i] @ followed
            column = column + N[:, r * m + i] * (share.tanh() if model.saturates else share)
        after = after + column * u[i]
    for d, signal in enumerate(model.drift_signal):
        share = S[model.rank * m + d] @ followed
        term = share.tanh() - share if signal == NO_SIGNAL else share.tanh() * w[signal]
        after = after + N[:, model.rank * m + d] * term
    return after


def roll_out(model: MdkNet, psi0: Tensor, u: Tensor, w: Tensor) -> Tensor:
    """Lifted states (K, n) after 1..K steps from psi0 (n,), with u (K, m) and w (K, p)."""
    A, B = model.operator()
    psi = followed = psi0
    states = []
    for k in range(len(u)):
        psi = step(model, psi, followed, u[k], w[k])
        states.append(psi)
        if model.follows is Follow.PREDICTION:
            followed = psi
        elif model.follows is Follow.FREE_RESPONSE:
            followed = A @ followed + B[:, model.sizes.inputs :] @ w[k]
    return torch.stack(states)
