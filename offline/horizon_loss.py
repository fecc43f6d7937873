"""What a model is trained on where the paper's loss is left behind: the figure it is judged by.

The mean squared error of each physical state over the whole horizon, every step of it counting
the same, and the mean of its logarithm over the states: a tenth less of one state's error is
worth as much as a tenth less of another's, whatever their units and however hard they are to
predict. Its minimum is the best geometric mean of the error ratios to any rival.

Only x_0 is encoded. No latent is a target, so no latent can be shrunk to please the loss.
"""

import torch
from torch import Tensor

from offline.batch import Batch
from offline.config import TrainingConfig
from offline.losses import Losses, prior_of, regularisation_loss, single_step_loss, stability_loss
from offline.model import MdkNet

LEAST_ERROR = 1e-12
"""keeps the logarithm finite where a state is predicted exactly"""


def state_errors(model: MdkNet, batch: Batch) -> Tensor:
    """Mean squared error of each scaled state over steps 1..K and the batch, (n_x,)."""
    predicted = _roll_out_states(model, batch)
    return (batch.x[1:] - predicted).square().mean(dim=(0, 1))


def log_error(errors: Tensor) -> Tensor:
    """Mean logarithm of the states' errors (n_x,): the logarithm of their geometric mean."""
    return (errors + LEAST_ERROR).log().mean()


def horizon_loss(
    model: MdkNet, config: TrainingConfig, batch: Batch, times: Tensor | None = None
) -> Losses:
    """The terms of eq. (13) with the log error of the states in place of the multi-step loss.

    The single-step loss, where it carries weight, is taken at `times` (M,) in 1..K, or at all.
    """
    A, B = model.operator()
    errors = state_errors(model, batch)
    multi_step = log_error(errors)
    single_step = multi_step.new_zeros(())
    if config.weight_single_step:
        if times is None:
            times = torch.arange(1, batch.steps + 1)
        single_step = _consistency(model, batch, times.to(batch.x.device))
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
    states = errors.detach().mean()
    return Losses(total, single_step, multi_step, stability, regularisation, states)


def horizon_of_step(step: int, steps: int, config: TrainingConfig, longest: int) -> int:
    """Length of the roll-outs at `step`: grown from `horizon_start` to the longest.

    Short ones first, since a random operator says nothing about steps far ahead.
    """
    if config.horizon_start is None:
        return longest
    first = min(config.horizon_start, longest)
    grown = step / max(config.horizon_growth * steps, 1.0)
    return min(longest, first + int((longest - first) * grown))


def _roll_out_states(model: MdkNet, batch: Batch) -> Tensor:
    psi0 = model.lift(batch.at(torch.zeros(1, dtype=torch.long, device=batch.x.device)))[0]
    return model.roll_out(psi0, batch.u, batch.w)[..., : model.sizes.states]


def _consistency(model: MdkNet, batch: Batch, times: Tensor) -> Tensor:
    """Single-step loss at these times, each step with the B of its own start."""
    before = model.lift(batch.at(times - 1))
    after = model.lift(batch.at(times))
    driven = model.drive(before, batch.u[times - 1], batch.w[times - 1])
    return single_step_loss(before, after, model.operator().A, driven)
