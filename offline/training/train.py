"""Training: Algorithm 1 of the paper, from top to bottom. Numbers in comments are its lines."""

import math
from collections.abc import Callable

import torch
from torch.nn.utils import clip_grad_norm_

from offline.config import TrainingConfig
from offline.data.dataset import Dataset
from offline.data.manifest import PARTS
from offline.data.sampling import open_source, validation_batch
from offline.model.encoder import MakeEncoder
from offline.model.losses import LossFunction, evaluate, horizon_of_step, total_loss
from offline.model.stability import spectral_radius
from offline.training.initial import choose_scaling, take_weights
from offline.training.optimizer import (
    cosine_rate,
    is_evaluated,
    is_over,
    keep_as_printed,
    keep_lowest,
    loss_of_kept_model,
)
from offline.training.run import Checkpoint, RunFolder, append_history, cut_history, save_checkpoint
from offline.training.state import (
    TrainingState,
    denormals_as_zero,
    find_device,
    initialise,
    recover,
)
from rt_controller.contract.errors import DatasetError
from rt_controller.model.bundle import Bundle


@denormals_as_zero()
def train(
    config: TrainingConfig,
    dataset: Dataset,
    run: RunFolder,
    *,
    loss: LossFunction = total_loss,
    encoder: MakeEncoder | None = None,
    first_model: Bundle | None = None,
    resume_from: Checkpoint | None = None,
    on_progress: Callable[[TrainingState], None] = lambda state: None,
    stop_requested: Callable[[], bool] = lambda: False,
) -> TrainingState:
    """The state after the last step, or after the step at which a stop is requested.

    `loss` is minimised, and selects the best model on the validation part. `encoder` makes the
    module of each encoder in place of the multilayer perceptron; `restore_model` and
    `export_checkpoint` then need it too. The training begins with the weights of `first_model`, or
    with random ones. The best and the last model are written to the run folder. `on_progress` is
    called after each step, with the same object. Paper: Algorithm 1.

    Raises:
        TrainingDivergedError: the loss is not finite, also at lower learning rates; the best
            checkpoint is kept.
        DatasetError: the training or the validation part is empty.
    """
    # 1: initialise. 2: normalise; the data set is partitioned when it is made.
    torch.set_num_threads(config.threads)
    for part in PARTS[:2]:
        if not len(dataset.select(part).episode):
            raise DatasetError(
                f"expected slices in the {part} part of the data set, found none: it has "
                f"{len(dataset.part)} episodes. Record more, or name another --data."
            )
    scaling = choose_scaling(dataset, first_model, resume_from)
    source = open_source(config, dataset, scaling)
    validation_part = validation_batch(dataset, scaling, config)
    state = initialise(config, dataset, scaling, find_device(config.device), encoder)
    model, optimizer = state.model, state.optimizer
    if resume_from is not None:
        state.restore(resume_from)
    elif first_model is not None:
        take_weights(model, first_model, scaling)
    cut_history(run, state.step)
    rule = keep_as_printed if config.best_rule == "as-printed" else keep_lowest
    state.best_validation_loss = loss_of_kept_model(state.validation_losses, config.patience, rule)

    # 3: until the last step.
    while not is_over(state.step, state.scheduled_rate, config) and not stop_requested():
        if config.rate_schedule == "cosine":
            rate = cosine_rate(state.step, config.steps, config.learning_rate)
            optimizer.rate = state.rate_share * rate

        # 4: select a batch.
        batch = source.draw(config.batch, state.rng).to(state.device)
        batch = batch.shorten(horizon_of_step(state.step, config, batch.steps))

        # 5, 6: encode, compute the loss and its gradient.
        losses = loss(model, config, batch)
        optimizer.zero_grad()
        losses.total.backward()  # type: ignore[no-untyped-call]
        gradient_norm = clip_grad_norm_(model.parameters(), config.gradient_clip or math.inf)

        # 7: update theta, A and B.
        if is_taken := bool(torch.isfinite(gradient_norm)):
            optimizer.step()

        # 17: count the step.
        state.count_step(losses, is_taken)
        if recover(run, state, dataset, scaling):
            continue

        # 8-10: evaluate.
        if is_evaluated(state.step, config):
            validation = evaluate(model, config, validation_part, state.device, loss)
            if recover(run, state, dataset, scaling, validation.total):
                continue
            state.validation_losses.append(validation.total)
            state.spectral_radius = spectral_radius(model)
            decision = rule(state.validation_losses, config.patience)
            append_history(
                run,
                {
                    "step": state.step - 1,
                    "train": state.take_mean_losses()._asdict(),
                    "validation": validation._asdict(),
                    "learning_rate": optimizer.rate,
                    "rate_share": state.rate_share,
                    "spectral_radius": state.spectral_radius,
                    "is_best": decision.is_best,
                    "skipped": state.skipped,
                },
            )
            # 11, 12: lower the rate. 13, 14: keep the best model.
            if decision.lower_rate and config.rate_schedule == "plateau":
                optimizer.rate *= 0.5
            checkpoint = state.to_checkpoint(config, scaling, dataset.sha256)
            if decision.is_best:
                state.best_validation_loss = validation.total
                save_checkpoint(run.best, checkpoint)
            save_checkpoint(run.last, checkpoint)

        on_progress(state)

    # 19: the best model is in run.best.
    state.is_finished = is_over(state.step, state.scheduled_rate, config)
    save_checkpoint(run.last, state.to_checkpoint(config, scaling, dataset.sha256))
    return state
