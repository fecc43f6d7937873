"""The training loss: the paper's terms, eqs. (9)-(13), and the log error over the horizon.

Time comes first in every array: psi is (times, batch, n). Sums over the batch are means, and norms
are taken over all n observables.
"""

from collections.abc import Callable, Iterable
from typing import Generic, NamedTuple, TypeVar

import torch
from torch import Tensor

from offline.config import TrainingConfig
from offline.data.sampling import Batch
from offline.model.network import MdkNet
from offline.model.stability import stability_loss

LEAST_ERROR = 1e-12
"""keeps the logarithm finite if a state is predicted exactly"""
CHUNK = 500
"""trajectories evaluated at once, which bounds the memory"""

Scalar = TypeVar("Scalar", Tensor, float)


class Losses(NamedTuple, Generic[Scalar]):
    """The terms of eq. (13) and their weighted sum: scalar tensors of a batch, or mean values."""

    total: Scalar
    single_step: Scalar
    multi_step: Scalar
    """eq. (10), or the log error of the states over the horizon"""
    stability: Scalar
    regularisation: Scalar
    states: Scalar
    """the physical states' share of the multi-step error, which scaling latents cannot reduce"""


LossFunction = Callable[[MdkNet, TrainingConfig, Batch], Losses[Tensor]]
"""the losses of a model on a batch; arguments as of `total_loss`, `total` is minimised"""


class Means(NamedTuple):
    """Means over trajectories, which the prediction terms of the loss follow from."""

    single_step: Tensor
    """() eq. (9)"""
    multi_step: Tensor
    """() eq. (10), or the errors (n_x,) of the states over the horizon"""
    states: Tensor
    """() as in `Losses`"""


def total_loss(model: MdkNet, config: TrainingConfig, batch: Batch) -> Losses[Tensor]:
    """Every term on one batch of scaled trajectories. Paper: eq. (13), eq:total loss."""
    psi0 = first_lift(model, batch)
    return loss_of_means(model, config, psi0, prediction_means(model, config, batch, psi0))


def prediction_means(model: MdkNet, config: TrainingConfig, batch: Batch, psi0: Tensor) -> Means:
    """The means of one batch; psi0 (batch, n) is its `first_lift`."""
    if config.objective == "horizon":
        return _horizon_means(model, config, batch, psi0)
    return _paper_means(model, config, batch)


def loss_of_means(
    model: MdkNet, config: TrainingConfig, psi0: Tensor, means: Means
) -> Losses[Tensor]:
    """The terms that follow from means over one batch or several, and those of the model alone.

    psi0 (batch, n) are lifted states of the data.
    """
    A, B = model.operator()
    multi_step = means.multi_step
    if config.objective == "horizon":
        multi_step = log_error(multi_step)
    stability = stability_loss(model, A, psi0, config)
    regularisation = regularisation_loss(
        model.encoders.parameters(), A, B, operator_prior(A, config), config
    )
    total = (
        config.weight_single_step * means.single_step
        + config.weight_multi_step * multi_step
        + config.weight_stability * stability
        + config.weight_regularisation * regularisation
    )
    return Losses(total, means.single_step, multi_step, stability, regularisation, means.states)


def single_step_loss(
    psi_before: Tensor, psi_after: Tensor, A: Tensor, forcing: Tensor, weight: Tensor | float = 1.0
) -> Tensor:
    """Squared error of one step of the linear model.

    psi_before, psi_after and forcing (= B u) are (times, batch, n), the weight of each trajectory
    (1, batch). Paper: eq. (9), eq:ssl loss, which has no weights.
    """
    return (weight * _squared_norm(psi_after - psi_before @ A.t() - forcing)).mean()


def multi_step_loss(psi: Tensor, predicted: Tensor, weights: Tensor) -> Tensor:
    """Weighted squared error of the roll-out from x_0.

    psi and predicted are (times, batch, n), weights (times,) as from `forgetting_weights`.
    Paper: eq. (10), eq:msl loss.
    """
    return weights @ _squared_norm(psi - predicted).mean(dim=1)


def forgetting_weights(steps: int, forgetting: float, through_last_step: bool) -> Tensor:
    """Weights beta^i / sum(beta^i) of the steps i = 1..K, (K,).

    Eq. (10) stops at K-1; without `through_last_step` the last weight is zero.
    """
    weights = forgetting ** torch.arange(1, steps + 1, dtype=torch.float64)
    if not through_last_step:
        weights[-1] = 0.0
    return (weights / weights.sum()).to(torch.get_default_dtype())


def first_lift(model: MdkNet, batch: Batch) -> Tensor:
    """psi_0 (batch, n)."""
    return model.lift(batch.at(torch.zeros(1, dtype=torch.long, device=batch.x.device)))[0]


def state_errors(model: MdkNet, batch: Batch, psi0: Tensor | None = None) -> Tensor:
    """Mean squared error of each scaled state over steps 1..K and the weighted batch, (n_x,).

    Only x_0 is encoded; `psi0`, if given, is its `first_lift`.
    """
    if psi0 is None:
        psi0 = first_lift(model, batch)
    predicted = model.roll_out(psi0, batch.u, batch.w)[..., : model.sizes.states]
    return batch.errors_of(predicted)


def log_error(errors: Tensor) -> Tensor:
    """Mean logarithm of the errors (n_x,), that is, the logarithm of their geometric mean.

    A tenth less error counts the same in every state, whatever its unit and size. No latent is a
    target, so shrinking latents does not reduce it.
    """
    return (errors + LEAST_ERROR).log().mean()


def regularisation_loss(
    encoder: Iterable[Tensor], A: Tensor, B: Tensor, prior: Tensor, config: TrainingConfig
) -> Tensor:
    """Squared size of the encoder's parameters, of A - prior (n, n), and of B.

    Paper: eq. (12), eq:reg loss.
    """
    theta = torch.stack([parameter.square().sum() for parameter in encoder]).sum()
    operator = (A - prior).square().sum() + B.square().sum()
    return config.decay_encoder * theta + config.decay_operator * operator


def operator_prior(A: Tensor, config: TrainingConfig) -> Tensor:
    """What eq. (12) measures A from, (n, n): zero as printed, or the identity.

    The identity does not pull the integrators of the model below 1.
    """
    if config.operator_prior == "zero":
        return torch.zeros_like(A)
    return torch.eye(A.shape[0], device=A.device, dtype=A.dtype)


def horizon_of_step(step: int, config: TrainingConfig, longest: int) -> int:
    """Number of steps of the roll-outs at this training step.

    Grows from `config.horizon_start` to `longest`; a random operator is useless far ahead.
    """
    if config.objective == "paper" or config.horizon_start is None:
        return longest
    first = min(config.horizon_start, longest)
    grown = step / max(config.horizon_growth * config.steps, 1.0)
    return min(longest, first + int((longest - first) * grown))


def evaluate(
    model: MdkNet,
    config: TrainingConfig,
    batch: Batch,
    device: torch.device,
    loss: LossFunction = total_loss,
) -> Losses[float]:
    """Losses over all trajectories; each is rolled out once.

    The logarithm is that of the mean error of all chunks; another `loss` than `total_loss` is the
    mean of its values over the chunks, weighted by their trajectories.

    Paper: Algorithm 1, "Evaluate total loss".
    """
    sums: list[Tensor | float] = [0.0] * len(
        Means._fields if loss is total_loss else Losses._fields
    )
    model.eval()
    with torch.no_grad():
        for share, chunk in batch.chunks(CHUNK):
            part = chunk.to(device)
            values: Iterable[Tensor]
            if loss is total_loss:
                psi0 = first_lift(model, part)
                values = prediction_means(model, config, part, psi0)
            else:
                values = loss(model, config, part)
            sums = [s + share * v.cpu().double() for s, v in zip(sums, values, strict=True)]
        if loss is total_loss:
            # In evaluation the stability term does not depend on the lifted states.
            means = Means(*map(torch.as_tensor, sums))
            sums = [*loss_of_means(model, config, psi0, means)]
    model.train()
    return Losses(*map(float, sums))


def _paper_means(model: MdkNet, config: TrainingConfig, batch: Batch) -> Means:
    """Single-step loss, multi-step loss, and the states' share of the latter."""
    steps = batch.steps
    weights = forgetting_weights(steps, config.forgetting, config.through_last_step)
    weights = weights.to(batch.x.device)
    psi = model.lift(batch.at(torch.arange(steps + 1, device=batch.x.device)))
    psi_before, psi_after = psi[:-1], psi[1:]
    predicted = model.roll_out(psi[0], batch.u, batch.w)
    forcing = model.forcing(psi_before, batch.u, batch.w)
    single_step = single_step_loss(psi_before, psi_after, model.operator().A, forcing)
    multi_step = multi_step_loss(psi_after, predicted, weights)
    with torch.no_grad():
        n = model.sizes.states
        states = multi_step_loss(psi_after[..., :n], predicted[..., :n], weights)
    return Means(single_step, multi_step, states)


def _horizon_means(model: MdkNet, config: TrainingConfig, batch: Batch, psi0: Tensor) -> Means:
    """Single-step loss if it has a weight, errors of the states, and their mean."""
    errors = state_errors(model, batch, psi0)
    single_step = errors.new_zeros(())
    if config.weight_single_step:
        times = torch.arange(1, batch.steps + 1, device=batch.x.device)
        before, after = model.lift(batch.at(times - 1)), model.lift(batch.at(times))
        forcing = model.forcing(before, batch.u, batch.w)
        weight = batch.weight[..., 0]
        single_step = single_step_loss(before, after, model.operator().A, forcing, weight)
    return Means(single_step, errors, errors.detach().mean())


def _squared_norm(error: Tensor) -> Tensor:
    return error.square().sum(dim=-1)
