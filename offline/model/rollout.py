"""Roll-outs of the lifted state in torch, for training.

psi_(k+1) = A psi_k + d_k is the inner part of the multi-step loss, eq. (10). The powers A^i of the
equation are not formed: the recursion is cheaper, and A is nearly defective at eigenvalue 1.
"""

from typing import Any, cast

import torch
from torch import Tensor


def roll_out(psi0: Tensor, A: Tensor, forcing: Tensor) -> Tensor:
    """Lifted states after 1..K steps, (K, batch, n).

    psi0 is (batch, n), A is (n, n), and forcing (K, batch, n) holds B u_k of each step. The
    gradient is the adjoint recursion l_k = g_k + A' l_(k+1); that of A is then one matrix product
    for all steps, a third faster than automatic differentiation and equal to it.
    Paper: the predicted term of eq. (10).
    """
    return cast(Tensor, _LinearRollOut.apply(psi0, A, forcing))  # type: ignore[no-untyped-call]


def roll_out_bilinear(
    psi0: Tensor, A: Tensor, B: Tensor, S: Tensor, N: Tensor, u: Tensor, w: Tensor
) -> Tensor:
    """Lifted states (K, batch, n) of psi+ = A psi + B [u; w] + sum_ri N_ri (S_ri psi) u_i.

    psi0 is (batch, n), A (n, n), B (n, m + p), S (R, m, n), N (R, n, m), u (K, batch, m) and
    w (K, batch, p).
    """
    rank, _, n = S.shape
    gains = S.reshape(-1, n).t()
    matrices = torch.cat([A.t(), B.t(), N.permute(0, 2, 1).flatten(0, 1)])
    signals, repeated = torch.cat([u, w], dim=-1), u.repeat(1, 1, rank)
    states, psi = [], psi0
    for k in range(len(u)):
        psi = torch.cat([psi, signals[k], (psi @ gains) * repeated[k]], dim=-1) @ matrices
        states.append(psi)
    return torch.stack(states)


class _LinearRollOut(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, psi0: Tensor, A: Tensor, forcing: Tensor) -> Tensor:
        states = torch.empty_like(forcing)
        transposed = A.t().contiguous()
        psi = psi0
        for k in range(forcing.shape[0]):
            psi = torch.addmm(forcing[k], psi, transposed, out=states[k])
        ctx.save_for_backward(psi0, A, states)
        return states

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        psi0, A, states = ctx.saved_tensors
        gradient = gradients[0]
        adjoint = torch.empty_like(states)
        adjoint[-1] = gradient[-1]
        for k in range(gradient.shape[0] - 2, -1, -1):
            torch.addmm(gradient[k], adjoint[k + 1], A, out=adjoint[k])
        before = torch.cat([psi0[None], states[:-1]])
        n = A.shape[0]
        grad_A = adjoint.reshape(-1, n).t() @ before.reshape(-1, n)
        return adjoint[0] @ A, grad_A, adjoint
