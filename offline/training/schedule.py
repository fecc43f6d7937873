"""Learning rate, evaluations, and the rule that keeps the best model.

Paper: Algorithm 1, from "Evaluate total loss" on. The printed rule compares each loss with the one
before and so may replace a better model by a worse one; the default rule keeps the lowest loss.
"""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

from offline.config import TrainingConfig

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
