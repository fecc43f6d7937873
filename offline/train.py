"""Training: Algorithm 1 of the paper, top to bottom.

`train` is a function of a configuration, a data set and a run folder. It knows no terminal: what
it has to say goes to `on_progress`, and `stop_requested` asks it to end at the next step.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch

from offline.batch import scale
from offline.checkpoint import Checkpoint, save_checkpoint
from offline.config import TrainingConfig
from offline.dataset import PARTS, Dataset
from offline.learner import Learner
from offline.losses import Losses
from offline.model import sizes_of
from offline.run_folder import RunFolder, append_history, cut_history
from offline.scaling import fit_scaling
from offline.schedule import (
    Verdict,
    is_evaluated,
    is_spent,
    judge_as_printed,
    judge_global_minimum,
    loss_of_kept_model,
)
from offline.source import open_source
from rt_controller.contract.errors import DatasetError, RtControllerError

MOST_SKIPPED_IN_A_ROW = 50


class TrainingDivergedError(RtControllerError):
    """The loss or its gradient stopped being a number."""


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a run stands."""

    step: int
    losses: Losses
    """of the newest batch"""
    learning_rate: float
    validation_loss: float
    """of the newest evaluation"""
    best_validation_loss: float
    """of the model that is kept, which need not be the lowest (`best_rule`)"""
    spectral_radius: float
    """of A at the newest evaluation"""


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a run ended."""

    step: int
    is_finished: bool
    best_validation_loss: float | None
    """of the model that was kept; none before the first evaluation"""
    skipped: int
    """steps whose gradient was not finite"""


def train(
    config: TrainingConfig,
    dataset: Dataset,
    run: RunFolder,
    *,
    resume_from: Checkpoint | None = None,
    on_progress: Callable[[Progress], None] = lambda progress: None,
    stop_requested: Callable[[], bool] = lambda: False,
) -> Outcome:
    """The run taken to its last step, or to the one at which a stop was requested.

    Best and last model are in the run folder in either case. Paper: Algorithm 1.

    Raises:
        TrainingDivergedError: the loss is not a number any more; the best checkpoint is kept.
    """
    torch.set_num_threads(config.threads)
    schema, roles = dataset.schema, dataset.roles
    _require_enough(dataset)
    scaling = fit_scaling(dataset.select("train"), schema, roles)
    source = open_source(config, dataset, scaling)
    validation_part = scale(
        dataset.select("validation"), scaling, schema, roles, config.history_steps
    )

    learner = Learner(config, sizes_of(schema, roles), scaling, dataset.sha256)
    if resume_from is not None:
        learner.restore(resume_from)
    cut_history(run, learner.step)
    judge = judge_as_printed if config.best_rule == "as-printed" else judge_global_minimum
    best_loss = loss_of_kept_model(learner.validation_losses, config.patience, judge)
    radius = learner.spectral_radius()
    skipped_in_a_row = 0

    while not _is_over(learner) and not stop_requested():
        learner.set_learning_rate()
        losses = learner.losses_on_random_batch(source)
        _require_finite(run, learner, "the loss", losses.total.item())
        skipped_in_a_row = 0 if learner.update(losses) else skipped_in_a_row + 1
        if skipped_in_a_row > MOST_SKIPPED_IN_A_ROW:
            _require_finite(run, learner, "the gradient", math.nan)

        if is_evaluated(learner.step, config):
            validation = learner.evaluate(validation_part)
            _require_finite(run, learner, "the validation loss", validation[0])
            learner.validation_losses.append(validation[0])
            radius = learner.spectral_radius()
            verdict = judge(learner.validation_losses, config.patience)
            _record(run, learner, validation, radius, verdict)
            if verdict.lower_rate and config.rate_schedule == "plateau":
                learner.halve_learning_rate()
            if verdict.is_best:
                best_loss = validation[0]
                save_checkpoint(run.best, learner.to_checkpoint())
            save_checkpoint(run.last, learner.to_checkpoint())

        on_progress(
            Progress(
                step=learner.step,
                losses=losses,
                learning_rate=learner.learning_rate,
                validation_loss=learner.validation_losses[-1],
                best_validation_loss=best_loss,
                spectral_radius=radius,
            )
        )

    save_checkpoint(run.last, learner.to_checkpoint())
    return Outcome(
        step=learner.step,
        is_finished=_is_over(learner),
        best_validation_loss=best_loss if math.isfinite(best_loss) else None,
        skipped=learner.skipped,
    )


def _is_over(learner: Learner) -> bool:
    config = learner.config
    return learner.step >= config.steps or is_spent(learner.learning_rate, config)


def _record(
    run: RunFolder, learner: Learner, validation: list[float], radius: float, verdict: Verdict
) -> None:
    append_history(
        run,
        {
            "step": learner.step - 1,
            "train": dict(zip(Losses._fields, learner.take_mean_losses(), strict=True)),
            "validation": dict(zip(Losses._fields, validation, strict=True)),
            "learning_rate": learner.learning_rate,
            "spectral_radius": radius,
            "is_best": verdict.is_best,
            "skipped": learner.skipped,
        },
    )


def _require_enough(dataset: Dataset) -> None:
    for part in PARTS[:2]:
        if not len(dataset.select(part).episode):
            raise DatasetError(
                f"expected slices in the {part} part of the data set, found none: it has "
                f"{len(dataset.part)} episodes. Record more, or name another --data."
            )


def _require_finite(run: RunFolder, learner: Learner, what: str, value: float) -> None:
    if not math.isfinite(value):
        raise TrainingDivergedError(
            f"{run.path}: expected {what} to be finite, found that it is not at step "
            f"{learner.step}. The best checkpoint so far is kept. Train again with a smaller "
            f"--learning-rate than {learner.config.learning_rate:g}, or with --gradient-clip."
        )
