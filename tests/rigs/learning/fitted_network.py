"""A network that predicts like a least-squares model: good enough for an export, in no time."""

from dataclasses import replace

import torch

from offline.data.dataset import Dataset
from offline.data.sampling import scale
from offline.model.encoder import MakeEncoder
from offline.training.run import Checkpoint, restore_model

RIDGE = 1e-6
FADING = 0.5
"""eigenvalue of the latents, which act on no state"""


def fitted(
    checkpoint: Checkpoint, dataset: Dataset, encoder: MakeEncoder | None = None
) -> Checkpoint:
    """The same encoder with the least-squares matrices of its data, and without gains."""
    model = restore_model(checkpoint, dataset.schema, dataset.roles, encoder)
    n_x, (rows, n) = model.sizes.states, model.A_rows.shape
    batch = scale(
        dataset.select("train"),
        checkpoint.scaling,
        dataset.schema,
        dataset.roles,
        model.history_steps,
    )
    before, after, u, w = (
        part.flatten(0, 1).double() for part in (batch.x[:-1], batch.x[1:], batch.u, batch.w)
    )
    psi, signals = torch.zeros(len(before), n).double(), torch.cat([u, w], dim=-1)
    psi[:, :n_x] = before
    if model.has_constant:
        psi[:, -1] = 1.0
    is_known = psi.abs().sum(dim=0) > 0.0
    A, B = FADING * torch.eye(rows, n), torch.zeros_like(model.B_rows)
    for i in range(n_x):
        of_psi = is_known & (model.A_learned[i] > 0.0)
        of_signals = model.B_learned[i] > 0.0
        regressors = torch.cat([psi[:, of_psi], signals[:, of_signals]], dim=1)
        target = after[:, i]
        # Some regressors are nearly proportional, such as speed and progress.
        normal = regressors.T @ regressors + RIDGE * len(psi) * torch.eye(regressors.shape[1])
        found = torch.linalg.solve(normal, regressors.T @ target).float()
        A[i] = 0.0
        A[i, of_psi], B[i, of_signals] = found.split([int(of_psi.sum()), int(of_signals.sum())])
    weights = {"A_rows": A, "B_rows": B, "N_rows": torch.zeros_like(model.N_rows)}
    return replace(checkpoint, model={**checkpoint.model, **weights})
