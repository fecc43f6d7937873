"""Optimiser, learning rate, evaluations, and the rule that keeps the best model.

The optimiser is Adam, or Muon for the matrices and Adam for the rest.

Muon (Jordan et al., 2024) replaces the gradient of a matrix by the nearest orthogonal matrix, so
that all directions of a matrix learn equally fast. The operator A always learns with Adam: its
gradient is large in few directions, and there only.

Paper: Algorithm 1, from "Evaluate total loss" on. The printed rule compares each loss with the one
before and so may replace a better model by a worse one; the default rule keeps the lowest loss.
"""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import torch
from torch import nn

from offline.config import TrainingConfig

SHARE = "share"
"""key of a group: its learning rate relative to the common one"""


class Optimizer:
    """Updates all parameters of a model, each group at its share of one learning rate."""

    def __init__(self, model: nn.Module, config: TrainingConfig) -> None:
        named = dict(model.named_parameters())
        operator = [named.pop(name) for name in ("A_rows", "path.change") if name in named]
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
        groups: list[dict[str, Any]] = [{"params": vectors, SHARE: 1.0}]
        if operator:
            groups.append({"params": operator, SHARE: config.operator_rate})
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


WARM_UP_SHARE = 0.05
"""share of the steps until a cosine schedule reaches its highest rate"""
LEAST_RATE_SHARE = 1e-3
"""share of the initial rate below which a halved rate no longer changes the model: ten halvings"""


class Decision(NamedTuple):
    """What follows from an evaluation."""

    is_best: bool
    lower_rate: bool


DecisionRule = Callable[[Sequence[float], int], Decision]


def keep_lowest(losses: Sequence[float], patience: int) -> Decision:
    """Keep the lowest loss so far; halve the rate after `patience` evaluations without one.

    After a halving the count restarts. `losses` are all validation losses, newest last.
    """
    best = float("inf")
    waited = 0
    decision = Decision(is_best=False, lower_rate=False)
    for loss in losses:
        if loss < best:
            best, waited, decision = loss, 0, Decision(is_best=True, lower_rate=False)
        else:
            waited += 1
            decision = Decision(is_best=False, lower_rate=waited == patience)
            waited %= patience
    return decision


def keep_as_printed(losses: Sequence[float], patience: int) -> Decision:
    """Algorithm 1 as printed: L_i > L_(i-1) > ... > L_(i-patience), else L_i < L_(i-1).

    The loss before the first evaluation counts as infinite.
    """
    recent = losses[-(patience + 1) :]
    if len(recent) == patience + 1 and all(later > earlier for earlier, later in pairwise(recent)):
        return Decision(is_best=False, lower_rate=True)
    previous = losses[-2] if len(losses) > 1 else float("inf")
    return Decision(is_best=losses[-1] < previous, lower_rate=False)


def loss_of_kept_model(losses: Sequence[float], patience: int, rule: DecisionRule) -> float:
    """Validation loss of the model that the rule has kept; infinite before the first."""
    kept = math.inf
    for count, loss in enumerate(losses, start=1):
        if rule(losses[:count], patience).is_best:
            kept = loss
    return kept


def cosine_rate(step: int, steps: int, highest: float) -> float:
    """Learning rate of a step: rises linearly over 5 % of the steps, then half a cosine to zero."""
    warm_up = max(1, round(WARM_UP_SHARE * steps))
    if step < warm_up:
        return highest * (step + 1) / warm_up
    return highest * 0.5 * (1.0 + math.cos(math.pi * (step - warm_up) / max(1, steps - warm_up)))


def is_evaluated(step: int, config: TrainingConfig) -> bool:
    """True if the model is evaluated after `step` steps.

    The paper counts from zero and evaluates after the first step; here also after the last.
    """
    return (step - 1) % config.evaluate_every == 0 or step == config.steps


def is_over(step: int, rate: float, config: TrainingConfig) -> bool:
    """True after the last step, or when the rate of a plateau schedule is too low to learn with.

    Algorithm 1 would continue to its last step without changing the model.
    """
    is_too_low = rate < LEAST_RATE_SHARE * config.learning_rate
    return step >= config.steps or (config.rate_schedule == "plateau" and is_too_low)
