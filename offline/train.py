"""Training: Algorithm 1 of the paper, top to bottom.

`train` is a function of a configuration, a data set and a run folder. It knows no terminal: what
it has to say goes to `on_progress`, and `stop_requested` asks it to end at the next step.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from offline.checkpoint import Checkpoint, save_checkpoint
from offline.config import TrainingConfig
from offline.dataset import Dataset, Trajectories
from offline.losses import Losses, draw_times, total_loss
from offline.model import MdkNet
from offline.run_folder import RunFolder, append_history, cut_history
from offline.scaling import Scaling, fit_scaling
from offline.schedule import judge_as_printed, judge_global_minimum
from rt_controller.contract.errors import RtControllerError

VALIDATION_CHUNK = 500
MOST_SKIPPED_IN_A_ROW = 50


class TrainingDivergedError(RtControllerError):
    """The loss or its gradient stopped being a number."""


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a run stands."""

    step: int
    losses: tuple[float, ...]
    """of the newest batch, in the order of `Losses`"""
    learning_rate: float
    validation_loss: float
    """of the newest evaluation"""
    best_validation_loss: float
    spectral_radius: float
    """of A at the newest evaluation"""


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a run ended."""

    step: int
    is_finished: bool
    best_validation_loss: float
    skipped: int


def train(
    config: TrainingConfig,
    dataset: Dataset,
    run: RunFolder,
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
    torch.manual_seed(config.seed)
    batches = torch.Generator().manual_seed(config.seed)
    train_part, validation_part = dataset.select("train"), dataset.select("validation")
    scaling = fit_scaling(train_part.x, train_part.u, train_part.kappa)
    x, u = normalise(train_part, scaling)
    x_validation, u_validation = normalise(validation_part, scaling)

    model = MdkNet(config)
    optimizer = torch.optim.Adam(model.parameters(), lr=config.learning_rate)
    judge = judge_as_printed if config.best_rule == "as-printed" else judge_global_minimum
    step, running, validation_losses, skipped = 0, RunningMean(), list[float](), 0
    if resume_from is not None:
        model.load_state_dict(resume_from.model)
        optimizer.load_state_dict(dict(resume_from.optimizer))
        batches.set_state(resume_from.batch_rng)
        torch.set_rng_state(resume_from.torch_rng)
        step, skipped = resume_from.step, resume_from.skipped
        running = RunningMean(resume_from.running_sums, resume_from.running_count)
        validation_losses = list(resume_from.validation_losses)
    cut_history(run, step)
    radius = spectral_radius(model)
    skipped_in_a_row = 0

    def checkpoint() -> Checkpoint:
        return Checkpoint(
            step=step,
            config=config,
            scaling=scaling,
            data_sha256=dataset.sha256,
            model=model.state_dict(),
            optimizer=optimizer.state_dict(),
            batch_rng=batches.get_state(),
            torch_rng=torch.get_rng_state(),
            validation_losses=validation_losses,
            running_sums=running.sums,
            running_count=running.count,
            skipped=skipped,
        )

    while step < config.steps and not stop_requested():
        chosen = torch.randint(x.shape[0], (config.batch,), generator=batches)
        times = None
        if config.target_samples is not None:
            times = draw_times(u.shape[1], config.target_samples, batches)
        losses = total_loss(model, _time_first(x[chosen]), _time_first(u[chosen]), config, times)
        if not torch.isfinite(losses.total):
            raise _diverged(run, step, "the loss", config)
        optimizer.zero_grad()
        losses.total.backward()  # type: ignore[no-untyped-call]
        norm = torch.nn.utils.clip_grad_norm_(
            model.parameters(), config.gradient_clip or math.inf, foreach=True
        )
        if torch.isfinite(norm):
            optimizer.step()
            skipped_in_a_row = 0
        else:
            skipped, skipped_in_a_row = skipped + 1, skipped_in_a_row + 1
            if skipped_in_a_row > MOST_SKIPPED_IN_A_ROW:
                raise _diverged(run, step, "the gradient", config)
        running.add(losses)
        step += 1

        if (step - 1) % config.evaluate_every == 0 or step == config.steps:
            validation = evaluate_losses(model, x_validation, u_validation, config)
            if not math.isfinite(validation[0]):
                raise _diverged(run, step, "the validation loss", config)
            validation_losses.append(validation[0])
            radius = spectral_radius(model)
            verdict = judge(validation_losses, config.patience)
            append_history(
                run,
                {
                    "step": step - 1,
                    "train": dict(zip(Losses._fields, running.take(), strict=True)),
                    "validation": dict(zip(Losses._fields, validation, strict=True)),
                    "learning_rate": optimizer.param_groups[0]["lr"],
                    "spectral_radius": radius,
                    "is_best": verdict.is_best,
                    "skipped": skipped,
                },
            )
            if verdict.lower_rate:
                optimizer.param_groups[0]["lr"] *= 0.5
            if verdict.is_best:
                save_checkpoint(run.best, checkpoint())
            save_checkpoint(run.last, checkpoint())

        on_progress(
            Progress(
                step=step,
                losses=tuple(loss.item() for loss in losses),
                learning_rate=optimizer.param_groups[0]["lr"],
                validation_loss=validation_losses[-1],
                best_validation_loss=min(validation_losses),
                spectral_radius=radius,
            )
        )

    save_checkpoint(run.last, checkpoint())
    return Outcome(step, step >= config.steps, min(validation_losses, default=math.inf), skipped)


def normalise(trajectories: Trajectories, scaling: Scaling) -> tuple[Tensor, Tensor]:
    """Scaled states (N, K+1, 6) and inputs with curvature (N, K, 4), float32."""
    curvature = np.broadcast_to(trajectories.kappa[:, None, None], (*trajectories.u.shape[:2], 1))
    u = np.concatenate([trajectories.u, curvature], axis=-1) / scaling.u_scale
    x = scaling.normalise_states(trajectories.x)
    return torch.from_numpy(x.astype(np.float32)), torch.from_numpy(u.astype(np.float32))


def evaluate_losses(
    model: MdkNet, x: Tensor, u: Tensor, config: TrainingConfig
) -> tuple[float, ...]:
    """Losses over all trajectories x (N, K+1, 6), u (N, K, 4), every target encoded."""
    sums = torch.zeros(len(Losses._fields), dtype=torch.float64)
    with torch.no_grad():
        for x_chunk, u_chunk in zip(
            x.split(VALIDATION_CHUNK), u.split(VALIDATION_CHUNK), strict=True
        ):
            losses = total_loss(model, _time_first(x_chunk), _time_first(u_chunk), config)
            sums += len(x_chunk) * torch.stack(losses).double()
    return tuple((sums / len(x)).tolist())


def spectral_radius(model: MdkNet) -> float:
    """Largest magnitude of an eigenvalue of A, in float64."""
    return float(np.abs(np.linalg.eigvals(model.A.detach().double().numpy())).max())


class RunningMean:
    """Mean of the training losses since the last evaluation."""

    def __init__(self, sums: list[float] | None = None, count: int = 0) -> None:
        self.sums = sums or [0.0] * len(Losses._fields)
        self.count = count

    def add(self, losses: Losses) -> None:
        self.sums = [total + loss.item() for total, loss in zip(self.sums, losses, strict=True)]
        self.count += 1

    def take(self) -> list[float]:
        """The mean; counting starts anew."""
        means = [total / self.count for total in self.sums]
        self.sums, self.count = [0.0] * len(self.sums), 0
        return means


def _time_first(trajectories: Tensor) -> Tensor:
    return trajectories.transpose(0, 1).contiguous()


def _diverged(
    run: RunFolder, step: int, what: str, config: TrainingConfig
) -> TrainingDivergedError:
    return TrainingDivergedError(
        f"{run.path}: expected {what} to be finite, found that it is not at step {step}. "
        f"The best checkpoint so far is kept. Train again with a smaller --learning-rate than "
        f"{config.learning_rate:g}, or with --gradient-clip."
    )
