"""Losses of a model on all trajectories of a part."""

import torch
from torch import Tensor

from offline.config import TrainingConfig
from offline.data.sampling import Batch
from offline.model.losses import (
    Losses,
    Means,
    first_lift,
    loss_of_means,
    prediction_means,
)
from offline.model.network import MdkNet

CHUNK = 500
"""trajectories evaluated at once, which bounds the memory"""


def evaluate(
    model: MdkNet, config: TrainingConfig, batch: Batch, device: torch.device
) -> Losses[float]:
    """Losses over all trajectories, with every target encoded; each is rolled out once.

    The logarithm is that of the mean error of all chunks.

    Paper: Algorithm 1, "Evaluate total loss".
    """
    sums: list[Tensor | float] = [0.0] * len(Means._fields)
    model.eval()
    with torch.no_grad():
        for share, chunk in batch.chunks(CHUNK):
            part = chunk.to(device)
            psi0 = first_lift(model, part)
            means = prediction_means(model, config, part, psi0)
            sums = [s + share * m.cpu().double() for s, m in zip(sums, means, strict=True)]
        # In evaluation the stability term does not depend on the lifted states.
        losses = loss_of_means(model, config, psi0, Means(*map(torch.as_tensor, sums)))
    model.train()
    return Losses(*map(float, losses))
