"""After each evaluation: is this the model to keep, and has the rate to fall?

Paper: Algorithm 1, the lines after "Evaluate total loss". The printed rule compares neighbours
only, so it may replace a better model by a worse one; the default rule does not.
"""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

from offline.config import TrainingConfig

WARM_UP_SHARE = 0.05
"""of the steps, until the rate of a cosine schedule is at its top"""
LEAST_SHARE = 1e-3
"""of its start, below which a rate that halves changes nothing any more: ten halvings"""


class Verdict(NamedTuple):
    """What an evaluation means for the training."""

    is_best: bool
    lower_rate: bool


def judge_global_minimum(losses: Sequence[float], patience: int) -> Verdict:
    """Keep the lowest loss so far; halve the rate after `patience` evaluations without one.

    After a halving the count starts anew. `losses` are all validation losses, newest last.
    """
    best = float("inf")
    waited = 0
    verdict = Verdict(is_best=False, lower_rate=False)
    for loss in losses:
        if loss < best:
            best, waited, verdict = loss, 0, Verdict(is_best=True, lower_rate=False)
        else:
            waited += 1
            verdict = Verdict(is_best=False, lower_rate=waited == patience)
            waited %= patience
    return verdict


def judge_as_printed(losses: Sequence[float], patience: int) -> Verdict:
    """Algorithm 1 to the letter: L_i > L_(i-1) > ... > L_(i-patience), else L_i < L_(i-1).

    Before the first evaluation the loss counts as infinite: nothing stands there to compare with.
    """
    recent = losses[-(patience + 1) :]
    if len(recent) == patience + 1 and all(later > earlier for earlier, later in pairwise(recent)):
        return Verdict(is_best=False, lower_rate=True)
    previous = losses[-2] if len(losses) > 1 else float("inf")
    return Verdict(is_best=losses[-1] < previous, lower_rate=False)


Judge = Callable[[Sequence[float], int], Verdict]


def loss_of_kept_model(losses: Sequence[float], patience: int, judge: Judge) -> float:
    """Validation loss of the model that the rule has kept; infinite before the first.

    The lowest of all only if the rule is to keep the lowest.
    """
    kept = math.inf
    for count, loss in enumerate(losses, start=1):
        if judge(losses[:count], patience).is_best:
            kept = loss
    return kept


def cosine_rate(step: int, steps: int, highest: float) -> float:
    """Learning rate of a step: linear up over the first twentieth, then half a cosine to zero."""
    warm_up = max(1, round(WARM_UP_SHARE * steps))
    if step < warm_up:
        return highest * (step + 1) / warm_up
    return highest * 0.5 * (1.0 + math.cos(math.pi * (step - warm_up) / max(1, steps - warm_up)))


def is_evaluated(step: int, config: TrainingConfig) -> bool:
    """Whether the model is evaluated after `step` steps.

    The paper counts from zero and evaluates after the very first step; the last step is evaluated
    too, so that no training is lost behind the last multiple.
    """
    return (step - 1) % config.evaluate_every == 0 or step == config.steps


def is_spent(rate: float, config: TrainingConfig) -> bool:
    """Whether a rate that only ever halves has become too low to learn with.

    Algorithm 1 would go on to its last step, and the model would stay what it is.
    """
    return config.rate_schedule == "plateau" and rate < LEAST_SHARE * config.learning_rate
