"""The roll-out with gains: against a loop, and its gradient against the numerical one."""

import pytest
import torch
from torch import Tensor

from offline.model.rollout import roll_out, roll_out_gains

pytestmark = pytest.mark.usefixtures("double_precision")

STEPS, BATCH, N, GAINS = 5, 3, 4, 6
saturation = pytest.mark.parametrize("saturates", [False, True])


def arguments(gains: int = GAINS) -> tuple[Tensor, ...]:
    """psi0, A, forcing, S, N, and the factors, which have no gradient."""
    torch.manual_seed(1)
    shapes = ((BATCH, N), (N, N), (STEPS, BATCH, N), (gains, N), (N, gains))
    made = [(0.6 * torch.randn(shape)).requires_grad_() for shape in shapes]
    return (*made, torch.randn(STEPS, BATCH, gains))


@saturation
def test_a_roll_out_is_the_recursion_written_out(saturates: bool) -> None:
    psi0, A, forcing, S, columns, factors = (each.detach() for each in arguments())
    found = roll_out_gains(psi0, A, forcing, S, columns, factors, saturates=saturates)
    assert found.shape == (STEPS, BATCH, N)
    for b in range(BATCH):
        psi = psi0[b]
        for k in range(STEPS):
            following = A @ psi + forcing[k, b]
            for i in range(GAINS):
                share = S[i] @ psi
                gain = share.tanh() if saturates else share
                following = following + columns[:, i] * gain * factors[k, b, i]
            psi = following
            torch.testing.assert_close(found[k, b], psi, rtol=1e-12, atol=1e-12)


@saturation
def test_the_gradient_equals_the_numerical_one(saturates: bool) -> None:
    *learned, factors = arguments()

    def rolled(*given: Tensor) -> Tensor:
        return roll_out_gains(*given, factors, saturates=saturates)

    assert torch.autograd.gradcheck(rolled, tuple(learned))


def test_without_gains_it_is_the_linear_roll_out_with_the_same_gradient() -> None:
    psi0, A, forcing, S, columns, factors = arguments(gains=0)
    without = roll_out_gains(psi0, A, forcing, S, columns, factors, saturates=True)
    linear = roll_out(psi0, A, forcing)
    assert torch.equal(without, linear)
    weights = torch.randn_like(linear)
    given = (psi0, A, forcing)
    ours = torch.autograd.grad((without * weights).sum(), given)
    theirs = torch.autograd.grad((linear * weights).sum(), given)
    assert all(torch.equal(one, other) for one, other in zip(ours, theirs, strict=True))


def test_a_later_step_does_not_change_an_earlier_state() -> None:
    psi0, A, forcing, S, columns, factors = (each.detach() for each in arguments())
    whole = roll_out_gains(psi0, A, forcing, S, columns, factors, saturates=True)
    short = roll_out_gains(psi0, A, forcing[:2], S, columns, factors[:2], saturates=True)
    assert torch.equal(whole[:2], short)
