"""The state of a training after some steps, and how it goes on when its numbers are not finite."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, field

import numpy as np
import torch

from offline.config import TrainingConfig
from offline.data.dataset import Dataset
from offline.data.signals import Scaling, signal_range
from offline.model.encoder import MakeEncoder
from offline.model.losses import Losses
from offline.model.network import MdkNet
from offline.model.observables import sizes_of
from offline.model.path import units_of
from offline.model.stability import spectral_radius
from offline.training.optimizer import Optimizer
from offline.training.run import Checkpoint, RunFolder, cut_history, load_checkpoint, load_weights
from rt_controller.contract.errors import ConfigError, RtControllerError

MOST_SKIPPED_IN_A_ROW = 50
"""steps that are not taken because the gradient is not finite"""
MOST_RECOVERIES = 6
"""then the learning rate is 1/64 of the configured one"""
COUNTERS = ("skipped", "rate_share", "running")
"""further fields of a state that its checkpoint has too"""


class TrainingDivergedError(RtControllerError):
    """The loss or its gradient is no longer finite, at any learning rate that was tried."""


@dataclass(slots=True)
class TrainingState:
    """Model, optimiser, random generator and losses after `step` steps."""

    model: MdkNet
    optimizer: Optimizer
    rng: torch.Generator
    """of the batches"""
    step: int = 0
    skipped: int = 0
    """steps that were not taken because the gradient was not finite"""
    skipped_in_a_row: int = 0
    validation_losses: list[float] = field(default_factory=list)
    """of all evaluations so far, newest last"""
    running: list[float] = field(default_factory=lambda: [0.0] * (len(Losses._fields) + 1))
    """sums of the training losses since the last evaluation, as `Losses`, and their number"""
    losses: Losses[torch.Tensor] = field(
        default_factory=lambda: Losses(*torch.zeros(len(Losses._fields)))
    )
    """of the newest batch"""
    rate_share: float = 1.0
    """learning rate relative to that of the schedule; halved when the numbers were not finite"""
    best_validation_loss: float = math.inf
    """of the model that is kept, which is the lowest unless `best_rule` says otherwise"""
    spectral_radius: float = math.nan
    """of A at the newest evaluation"""
    is_finished: bool = False
    """True after the last step, or once the rate is too low to change the model"""

    @property
    def device(self) -> torch.device:
        return self.model.A_rows.device

    @property
    def scheduled_rate(self) -> float:
        """The learning rate as it would be if the numbers had always been finite."""
        return self.optimizer.rate / self.rate_share

    def count_step(self, losses: Losses[torch.Tensor], is_taken: bool) -> None:
        """Count a step, taken or skipped, with its losses."""
        self.step += 1
        self.skipped += not is_taken
        self.skipped_in_a_row = 0 if is_taken else self.skipped_in_a_row + 1
        self.losses = losses
        values = [*torch.stack(losses).detach().tolist(), 1.0]
        self.running = [s + v for s, v in zip(self.running, values, strict=True)]

    def take_mean_losses(self) -> Losses[float]:
        """Mean training losses since the last call."""
        *sums, count = self.running
        self.running = [0.0] * len(self.running)
        return Losses(*(s / max(count, 1.0) for s in sums))

    def to_checkpoint(
        self, config: TrainingConfig, scaling: Scaling, data_sha256: str
    ) -> Checkpoint:
        """Everything that `restore` needs to continue bit by bit."""
        training = {name: copy(getattr(self, name)) for name in COUNTERS} | {
            "optimizer": self.optimizer.state_dict(),
            "batch_rng": self.rng.get_state(),
            "torch_rng": torch.get_rng_state(),
        }
        weights, losses = self.model.state_dict(), copy(self.validation_losses)
        return Checkpoint(self.step, config, scaling, data_sha256, weights, losses, training)

    def restore(self, checkpoint: Checkpoint) -> None:
        """Continue from a checkpoint."""
        load_weights(self.model, checkpoint)
        stored = checkpoint.training
        self.optimizer.load_state_dict(stored["optimizer"])
        self.rng.set_state(stored["batch_rng"])
        torch.set_rng_state(stored["torch_rng"])
        for name in COUNTERS:
            setattr(self, name, copy(stored[name]))
        self.step, self.validation_losses = checkpoint.step, copy(checkpoint.validation_losses)
        self.skipped_in_a_row = 0
        self.spectral_radius = spectral_radius(self.model)


def initialise(
    config: TrainingConfig,
    dataset: Dataset,
    scaling: Scaling,
    device: torch.device,
    encoder: MakeEncoder | None = None,
) -> TrainingState:
    """The state before the first step; the seed determines weights and batches."""
    torch.manual_seed(config.seed)
    found = signal_range(dataset.select("train"), dataset.schema)
    scaled = torch.from_numpy(found / np.concatenate([scaling.u_scale, scaling.w_scale]))
    sizes = sizes_of(dataset.schema, dataset.roles)
    units = units_of(scaling) if sizes.has_path else None
    model = MdkNet(config, sizes, scaled.float(), encoder, units).to(device)
    rng = torch.Generator().manual_seed(config.seed)
    return TrainingState(model, Optimizer(model, config), rng)


def recover(
    run: RunFolder,
    state: TrainingState,
    dataset: Dataset,
    scaling: Scaling,
    validation_loss: float = 0.0,
) -> bool:
    """True if a number was not finite: the state is that of the last evaluation, at half the rate.

    A number: the loss, many gradients in a row, or the loss of an evaluation that is not yet part
    of the state.

    Raises:
        TrainingDivergedError: there was no evaluation yet, or the rate was halved `MOST_RECOVERIES`
            times. The message names the largest step in the data.
    """
    if not math.isfinite(state.losses.total.item()):
        what = "the loss"
    elif state.skipped_in_a_row > MOST_SKIPPED_IN_A_ROW:
        what = "the gradient"
    elif not math.isfinite(validation_loss):
        what = "the validation loss"
    else:
        return False
    rate_share = 0.5 * state.rate_share
    if not run.last.exists() or rate_share < 0.5**MOST_RECOVERIES:
        rate = run.config.learning_rate
        raise TrainingDivergedError(
            f"{run.path}: expected {what} to be finite, found that it is not at step {state.step}, "
            f"also with {state.rate_share:g} of the learning rate of {rate:g}. "
            f"{largest_step(dataset, scaling)} If that is an error of the recording, "
            f"leave the episode out or mend the log; otherwise train again with "
            f"--learning-rate {rate * rate_share:.1g}. The best checkpoint so far is kept."
        )
    state.restore(load_checkpoint(run.last))
    state.rate_share = rate_share
    state.optimizer.rate *= 0.5
    cut_history(run, state.step)
    return True


def largest_step(dataset: Dataset, scaling: Scaling) -> str:
    """A sentence about the largest change of a recorded signal from one sample to the next."""
    recording = dataset.recording
    states = recording.x.shape[1]
    x, u = recording.x / scaling.x_scale[:states], recording.u / scaling.u_scale
    change = np.abs(np.diff(np.concatenate([x, u], axis=1), axis=0))
    change[recording.first[1:] - 1] = 0.0
    row, column = np.unravel_index(int(np.argmax(change)), change.shape)
    episode = int(np.searchsorted(recording.first, row, side="right")) - 1
    name = (dataset.schema.state_names[:states] + dataset.schema.input_names)[column]
    return (
        f"The largest change within one period is that of {name} after sample "
        f"{row - recording.first[episode]} of episode {episode}: {change[row, column]:.3g} times "
        f"its scale."
    )


@contextmanager
def denormals_as_zero() -> Iterator[None]:
    """Within it, the calling thread takes denormal numbers for zero; after it, no longer.

    The penalty on the weights makes those of unused units denormal; the processor then multiplies
    several times more slowly.
    """
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(False)


def find_device(name: str) -> torch.device:
    """The torch device of that name.

    Raises:
        ConfigError: this machine does not have it, or there is no such name.
    """
    try:
        device = torch.device(name)
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        reason = str(error).splitlines()[0].rstrip(".")
        raise ConfigError(
            f"--device {name}: expected a device that torch can compute on here, found none "
            f"({reason}). Take cpu, or install a torch built for it."
        ) from error
    return device
