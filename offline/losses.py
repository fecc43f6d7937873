"""The loss terms of the paper, each a function of its own.

What stands for them in the presets that go beyond the paper is in `offline.horizon_loss`.

Time comes first in every array here: psi is (times, batch, n). A sum over the batch is a mean,
a norm is taken over all n observables. Paper: eqs. (9)-(13).
"""

from collections.abc import Iterable
from typing import NamedTuple

import torch
from torch import Tensor

from offline.batch import Batch
from offline.config import TrainingConfig
from offline.model import MdkNet

GROWTH_DOUBLINGS = 6
GROWTH_BOUND = 1.035
"""slightly above what yaw rate -> heading -> lateral error alone scores: a chain of integrators
is a Jordan block at 1, whose powers grow although no eigenvalue exceeds 1"""


class Losses(NamedTuple):
    """The terms of eq. (13) and their weighted sum, each a scalar tensor."""

    total: Tensor
    single_step: Tensor
    multi_step: Tensor
    stability: Tensor
    regularisation: Tensor
    states: Tensor
    """the physical states' share of `multi_step`: the encoder cannot shrink these targets"""


def single_step_loss(psi_before: Tensor, psi_after: Tensor, A: Tensor, drive: Tensor) -> Tensor:
    """How far one step of the linear model misses the next lifted state.

    psi_before, psi_after and drive (= B u) are (times, batch, n). Paper: eq. (9), eq:ssl loss.
    """
    return _squared_norm(psi_after - psi_before @ A.t() - drive).mean()


def multi_step_loss(psi: Tensor, predicted: Tensor, weights: Tensor) -> Tensor:
    """How far the roll-out from x_0 misses the lifted states, near future first.

    psi and predicted are (times, batch, n), weights (times,) as `forgetting_weights` makes them.
    Paper: eq. (10), eq:msl loss.
    """
    return weights @ _squared_norm(psi - predicted).mean(dim=1)


def forgetting_weights(steps: int, forgetting: float, through_last_step: bool) -> Tensor:
    """Weights beta^i / sum(beta^i) of the steps i = 1..K, (K,).

    Eq. (10) stops at K-1; then the last weight is zero.
    """
    weights = forgetting ** torch.arange(1, steps + 1, dtype=torch.float64)
    if not through_last_step:
        weights[-1] = 0.0
    return (weights / weights.sum()).to(torch.get_default_dtype())


def eigenvalue_excess(A: Tensor) -> Tensor:
    """Sum of what each eigenvalue's magnitude exceeds 1 by. Paper: eq. (11), eq:sl loss.

    In float64. Its gradient grows without bound where eigenvalues meet, which at 1 they do: the
    training loop skips steps whose gradient is not finite.
    """
    magnitudes = torch.linalg.eigvals(A.double()).abs()
    return torch.relu(magnitudes - 1.0).sum().to(A.dtype)


def growth_excess(A: Tensor) -> Tensor:
    """What ||A^64||_F^(1/64) exceeds its bound by.

    Stands in for eq. (11): by Gelfand's formula the root tends to the spectral radius, and its
    gradient stays near 1 also where eigenvalues meet.
    """
    power = A
    for _ in range(GROWTH_DOUBLINGS):
        power = power @ power
    return torch.relu(torch.linalg.matrix_norm(power) ** (0.5**GROWTH_DOUBLINGS) - GROWTH_BOUND)


def regularisation_loss(
    encoder: Iterable[Tensor], A: Tensor, B: Tensor, prior: Tensor, config: TrainingConfig
) -> Tensor:
    """Squared size of the encoder's parameters and of the matrices. Paper: eq. (12), eq:reg loss.

    A is measured from `prior` (n, n): zero as printed, or the identity, which does not pull the
    integrators of the model below 1.
    """
    theta = torch.stack([parameter.square().sum() for parameter in encoder]).sum()
    operator = (A - prior).square().sum() + B.square().sum()
    return config.decay_encoder * theta + config.decay_operator * operator


def total_loss(
    model: MdkNet, config: TrainingConfig, batch: Batch, times: Tensor | None = None
) -> Losses:
    """Every term on one batch of scaled trajectories. Paper: eq. (13), eq:total loss.

    `times` (M,) in 1..K as `draw_times` draws them limits the targets that are encoded; the sums
    over time are then estimated without bias.
    """
    steps = batch.steps
    A, B = model.operator()
    weights = forgetting_weights(steps, config.forgetting, config.through_last_step)
    weights = weights.to(batch.x.device)
    if times is None:
        psi = model.lift(batch.at(torch.arange(steps + 1, device=batch.x.device)))
        psi0, psi_before, psi_after = psi[0], psi[:-1], psi[1:]
        u, w = batch.u, batch.w
        predicted = model.roll_out(psi0, u, w)
    else:
        m, times = len(times), times.to(batch.x.device)
        psi = model.lift(batch.at(torch.cat([times.new_zeros(1), times - 1, times])))
        psi0, psi_before, psi_after = psi[0], psi[1 : m + 1], psi[m + 1 :]
        u, w = batch.u[times - 1], batch.w[times - 1]
        predicted = model.roll_out(psi0, batch.u, batch.w)[times - 1]
        weights = weights[times - 1] * (steps / m)

    single_step = single_step_loss(psi_before, psi_after, A, model.drive(psi_before, u, w))
    multi_step = multi_step_loss(psi_after, predicted, weights)
    stability = stability_loss(A, config)
    regularisation = regularisation_loss(
        model.encoder.parameters(), A, B, prior_of(A, config), config
    )
    total = (
        config.weight_single_step * single_step
        + config.weight_multi_step * multi_step
        + config.weight_stability * stability
        + config.weight_regularisation * regularisation
    )
    with torch.no_grad():
        n = model.sizes.states
        states = multi_step_loss(psi_after[..., :n], predicted[..., :n], weights)
    return Losses(total, single_step, multi_step, stability, regularisation, states)


def prior_of(A: Tensor, config: TrainingConfig) -> Tensor:
    """What eq. (12) measures A from, (n, n)."""
    if config.operator_prior == "zero":
        return torch.zeros_like(A)
    return torch.eye(A.shape[0], device=A.device, dtype=A.dtype)


def stability_loss(A: Tensor, config: TrainingConfig) -> Tensor:
    """Eq. (11), or what stands in for it; zero where the operator is projected instead."""
    if config.stability == "eigenvalue":
        return eigenvalue_excess(A)
    if config.stability == "gelfand":
        return growth_excess(A)
    return A.new_zeros(())


def draw_times(steps: int, samples: int, generator: torch.Generator) -> Tensor:
    """Target times in 1..K, (samples,), one from each of `samples` equal parts of the horizon.

    Every time is drawn with the same mean frequency, samples / K, whether or not K divides.
    """
    parts = torch.arange(samples, dtype=torch.float64)
    offsets = torch.rand(samples, generator=generator, dtype=torch.float64)
    return ((parts + offsets) * (steps / samples)).long().clamp_(max=steps - 1) + 1


def _squared_norm(error: Tensor) -> Tensor:
    return error.square().sum(dim=-1)
