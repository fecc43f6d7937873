"""Losses of a model on all trajectories of a part."""

import torch

from offline.config import TrainingConfig
from offline.data.sampling import Batch
from offline.model.losses import Losses, log_error, state_errors, total_loss
from offline.model.network import MdkNet

CHUNK = 500
"""trajectories evaluated at once, which bounds the memory"""


def evaluate(
    model: MdkNet, config: TrainingConfig, batch: Batch, device: torch.device
) -> Losses[float]:
    """Losses over all trajectories, with every target encoded.

    Paper: Algorithm 1, "Evaluate total loss".
    """
    sums = torch.zeros(len(Losses._fields), dtype=torch.float64)
    errors = torch.zeros(model.sizes.states, dtype=torch.float64)
    is_horizon = config.objective == "horizon"
    model.eval()
    with torch.no_grad():
        for share, chunk in batch.chunks(CHUNK):
            part = chunk.to(device)
            sums += share * torch.stack(total_loss(model, config, part)).cpu().double()
            if is_horizon:
                errors += share * state_errors(model, part).cpu().double()
    model.train()
    means = Losses(*sums.tolist())
    if not is_horizon:
        return means
    # The logarithm of the mean error, not the mean of the chunks' logarithms.
    exact = float(log_error(errors))
    total = means.total + config.weight_multi_step * (exact - means.multi_step)
    return means._replace(total=total, multi_step=exact)
