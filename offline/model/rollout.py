"""Roll-outs of the lifted state in torch, for training.

psi_(k+1) = A psi_k + d_k is the inner part of the multi-step loss, eq. (10). The powers A^i of the
equation are not formed: the recursion is cheaper, and A is nearly defective at eigenvalue 1.
"""

from typing import Any, cast

import torch
from torch import Tensor


def roll_out(
    psi0: Tensor,
    A: Tensor,
    forcing: Tensor,
    gains: tuple[Tensor, Tensor, Tensor] | None = None,
    saturates: bool = False,
) -> Tensor:
    """Lifted states (K, batch, n) after 1..K steps of psi+ = A psi + d_k + N (g(S psi) v_k).

    psi0 is (batch, n), A (n, n), and forcing d (K, batch, n) holds B u_k of each step. `gains` are
    S (q, n), N (n, q) and the factors v (K, batch, q), which have no gradient; None: there are
    none. g is the hyperbolic tangent if they saturate, otherwise the identity. The gradient is the
    adjoint recursion, for A l_k = g_k + A' l_(k+1); that of A is then one matrix product for all
    steps, a third faster than automatic differentiation and equal to it.
    Paper: the predicted term of eq. (10).
    """
    if gains is None:
        none = psi0.new_zeros(0, psi0.shape[1])
        gains = none, none.t(), psi0.new_zeros(len(forcing), len(psi0), 0)
    rolled = _RollOut.apply(psi0, A, forcing, *gains, saturates)  # type: ignore[no-untyped-call]
    return cast(Tensor, rolled)


class _RollOut(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        psi0: Tensor,
        A: Tensor,
        forcing: Tensor,
        S: Tensor,
        N: Tensor,
        factors: Tensor,
        saturates: bool,
    ) -> Tensor:
        (steps, batch, n), q = forcing.shape, len(S)
        states, gains = torch.empty_like(forcing), torch.empty_like(factors)
        terms = forcing.new_empty(steps, batch, n + q)
        S_t, columns = S.t().contiguous(), torch.cat([A.t(), N.t()])
        psi = psi0
        for k in range(steps):
            gain = torch.mm(psi, S_t, out=gains[k])
            if saturates:
                gain.tanh_()
            terms[k, :, :n] = psi
            torch.mul(gain, factors[k], out=terms[k, :, n:])
            psi = torch.addmm(forcing[k], terms[k], columns, out=states[k])
        ctx.save_for_backward(A, S, N, factors, gains, terms)
        ctx.saturates = saturates
        return states

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        A, S, N, factors, gains, terms = ctx.saved_tensors
        gradient = gradients[0]
        steps, _, n = gradient.shape
        adjoint, of_shares = torch.empty_like(gradient), torch.empty_like(gains)
        rows = torch.cat([A, N], dim=1)
        slopes = factors * (1.0 - gains.square()) if ctx.saturates else factors
        below = torch.zeros_like(gradient[0])
        for k in range(steps - 1, -1, -1):
            torch.add(gradient[k], below, out=adjoint[k])
            of_terms = adjoint[k] @ rows
            of_share = torch.mul(of_terms[:, n:], slopes[k], out=of_shares[k])
            below = torch.addmm(of_terms[:, :n], of_share, S)
        rows_of_terms = terms.flatten(0, 1)
        grad_rows = adjoint.flatten(0, 1).t() @ rows_of_terms
        grad_S = of_shares.flatten(0, 1).t() @ rows_of_terms[:, :n]
        return below, grad_rows[:, :n], adjoint, grad_S, grad_rows[:, n:], None, None
