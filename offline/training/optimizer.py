"""The optimiser of a training: Adam, or Muon for the matrices and Adam for the rest.

Muon (Jordan et al., 2024) replaces the gradient of a matrix by the nearest orthogonal matrix, so
that all directions of a matrix learn equally fast. The operator A always learns with Adam: its
gradient is large in few directions, and there only.
"""

from typing import Any

import torch

from offline.config import TrainingConfig
from offline.model.network import MdkNet

SHARE = "share"
"""key of a group: its learning rate relative to the common one"""


class Optimizer:
    """Updates all parameters of a model, each group at its share of one learning rate."""

    def __init__(self, model: MdkNet, config: TrainingConfig) -> None:
        named = dict(model.named_parameters())
        operator = named.pop("A_rows")
        matrices = [each for each in named.values() if each.ndim == 2]
        vectors = [each for each in named.values() if each.ndim != 2]
        if config.optimizer == "adam":
            matrices, vectors = [], [*named.values()]
        self._parts: list[torch.optim.Optimizer] = []
        if matrices:
            group = {"params": matrices, SHARE: config.matrix_rate}
            self._parts.append(
                torch.optim.Muon([group], weight_decay=0.0, adjust_lr_fn="match_rms_adamw")
            )
        groups: list[dict[str, Any]] = [
            {"params": vectors, SHARE: 1.0},
            {"params": [operator], SHARE: config.operator_rate},
        ]
        self._parts.append(torch.optim.Adam(groups))
        self.rate = config.learning_rate

    @property
    def rate(self) -> float:
        """The common learning rate."""
        group = self._parts[0].param_groups[0]
        return float(group["lr"] / group[SHARE])

    @rate.setter
    def rate(self, rate: float) -> None:
        for part in self._parts:
            for group in part.param_groups:
                group["lr"] = group[SHARE] * rate

    def zero_grad(self) -> None:
        for part in self._parts:
            part.zero_grad()

    def step(self) -> None:
        for part in self._parts:
            part.step()

    def state_dict(self) -> dict[str, Any]:
        """All that `load_state_dict` needs to continue bit by bit."""
        return {"parts": [part.state_dict() for part in self._parts]}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        for part, stored in zip(self._parts, state["parts"], strict=True):
            part.load_state_dict(stored)
