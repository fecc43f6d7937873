"""Losses of a model on all trajectories of a part."""

from collections.abc import Iterable

import torch
from torch import Tensor

from offline.config import TrainingConfig
from offline.data.sampling import Batch
from offline.model.losses import (
    Losses,
    LossFunction,
    Means,
    first_lift,
    loss_of_means,
    prediction_means,
    total_loss,
)
from offline.model.network import MdkNet

CHUNK = 500
"""trajectories evaluated at once, which bounds the memory"""


def evaluate(
    model: MdkNet,
    config: TrainingConfig,
    batch: Batch,
    device: torch.device,
    loss: LossFunction = total_loss,
) -> Losses[float]:
    """Losses over all trajectories, with every target encoded; each is rolled out once.

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
                values = loss(model, config, part, None)
            sums = [s + share * v.cpu().double() for s, v in zip(sums, values, strict=True)]
        if loss is total_loss:
            # In evaluation the stability term does not depend on the lifted states.
            means = Means(*map(torch.as_tensor, sums))
            sums = [*loss_of_means(model, config, psi0, means)]
    model.train()
    return Losses(*map(float, sums))
