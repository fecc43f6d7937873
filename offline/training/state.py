"""The state of a training: everything that changes from step to step, and its checkpoint."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
import torch

from offline.config import TrainingConfig
from offline.data.dataset import Dataset
from offline.data.signals import Scaling, signal_range
from offline.model.losses import Losses
from offline.model.network import MakeEncoder, MdkNet, sizes_of
from offline.model.spectrum import spectral_radius
from offline.training.checkpoint import Checkpoint, load_weights
from offline.training.optimizer import Optimizer
from rt_controller.contract.errors import ConfigError


def _no_losses() -> torch.Tensor:
    return torch.zeros(len(Losses._fields), dtype=torch.float64)


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
    loss_sums: torch.Tensor = field(default_factory=_no_losses)
    """of the training losses since the last evaluation, in the order of `Losses`"""
    loss_count: int = 0
    losses: Losses[torch.Tensor] = field(default_factory=lambda: Losses(*_no_losses()))
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
    def scheduled_rate(self) -> float:
        """The learning rate as it would be if the numbers had always been finite."""
        return self.learning_rate / self.rate_share

    @property
    def device(self) -> torch.device:
        return self.model.A_rows.device

    @property
    def learning_rate(self) -> float:
        return self.optimizer.rate

    @learning_rate.setter
    def learning_rate(self, rate: float) -> None:
        self.optimizer.rate = rate

    def count_step(self, losses: Losses[torch.Tensor], is_taken: bool) -> None:
        """Count a step, taken or skipped, with its losses."""
        self.step += 1
        self.skipped += not is_taken
        self.skipped_in_a_row = 0 if is_taken else self.skipped_in_a_row + 1
        self.losses = losses
        self.loss_sums += torch.stack(losses).detach().cpu().double()
        self.loss_count += 1

    def take_mean_losses(self) -> Losses[float]:
        """Mean training losses since the last call."""
        means = (self.loss_sums / max(self.loss_count, 1)).tolist()
        self.loss_sums, self.loss_count = _no_losses(), 0
        return Losses(*means)

    def to_checkpoint(
        self, config: TrainingConfig, scaling: Scaling, data_sha256: str
    ) -> Checkpoint:
        """Everything that `restore` needs to continue bit by bit."""
        return Checkpoint(
            step=self.step,
            config=config,
            scaling=scaling,
            data_sha256=data_sha256,
            model=self.model.state_dict(),
            optimizer=self.optimizer.state_dict(),
            batch_rng=self.rng.get_state(),
            torch_rng=torch.get_rng_state(),
            validation_losses=self.validation_losses,
            running_sums=self.loss_sums.tolist(),
            running_count=self.loss_count,
            skipped=self.skipped,
            rate_share=self.rate_share,
        )

    def restore(self, checkpoint: Checkpoint) -> None:
        """Continue from a checkpoint."""
        load_weights(self.model, checkpoint)
        self.optimizer.load_state_dict(dict(checkpoint.optimizer))
        self.rng.set_state(checkpoint.batch_rng)
        torch.set_rng_state(checkpoint.torch_rng)
        self.step = checkpoint.step
        self.skipped, self.skipped_in_a_row = checkpoint.skipped, 0
        self.rate_share = checkpoint.rate_share
        self.validation_losses = list(checkpoint.validation_losses)
        self.loss_sums = torch.tensor(checkpoint.running_sums, dtype=torch.float64)
        self.loss_count = checkpoint.running_count
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
    model = MdkNet(config, sizes, scaled.float(), encoder).to(device)
    rng = torch.Generator().manual_seed(config.seed)
    return TrainingState(model, Optimizer(model, config), rng)


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
