"""The state of a training: everything that changes from step to step, and its checkpoint."""

import math
import pickle
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from copy import copy
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from offline.config import TrainingConfig
from offline.data.dataset import Dataset
from offline.data.signals import Scaling, signal_range
from offline.model.losses import Losses
from offline.model.network import MakeEncoder, MdkNet, sizes_of
from offline.model.stability import spectral_radius
from offline.training.optimizer import Optimizer
from rt_controller.contract.errors import ArtifactError, ConfigError, OutputError
from rt_controller.contract.files import atomic_write


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """State of a run after `step` steps."""

    step: int
    config: TrainingConfig
    scaling: Scaling
    data_sha256: str
    model: Mapping[str, Any]
    optimizer: Mapping[str, Any]
    batch_rng: torch.Tensor
    torch_rng: torch.Tensor
    validation_losses: list[float]
    """of all evaluations so far, newest last"""
    running_sums: list[float]
    """of the training losses since the last evaluation, in the order of `Losses`"""
    running_count: int
    skipped: int
    """steps that were not taken because the gradient was not finite"""
    rate_share: float = 1.0
    """learning rate relative to that of the schedule"""


def save_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Replace the file as a whole; a crash leaves the previous checkpoint.

    Raises:
        OutputError: there is no room.
    """
    fields = {name: getattr(checkpoint, name) for name in Checkpoint.__dataclass_fields__}
    fields["config"] = checkpoint.config.model_dump_json()
    fields["scaling"] = {
        name: torch.from_numpy(array) for name, array in asdict(checkpoint.scaling).items()
    }
    try:
        with atomic_write(path) as stream:
            torch.save(fields, stream)
    except (OSError, RuntimeError) as error:
        raise OutputError(
            f"{path}: expected room for a checkpoint, found: {error}. The previous checkpoint is "
            f"untouched: free some space and resume the run."
        ) from error


def load_checkpoint(path: Path) -> Checkpoint:
    """Read a checkpoint.

    Raises:
        ArtifactError: there is none, or the file is truncated or has another format.
    """
    try:
        fields = torch.load(path, map_location="cpu", weights_only=True)
        fields["config"] = TrainingConfig.model_validate_json(fields["config"])
        fields["scaling"] = Scaling(
            **{name: tensor.numpy() for name, tensor in fields["scaling"].items()}
        )
        return Checkpoint(**fields)
    except FileNotFoundError as error:
        raise ArtifactError(
            f"{path}: expected a checkpoint, found no such file. Train a model with "
            f"offline-train, or name the folder of a run."
        ) from error
    except (
        OSError,
        RuntimeError,
        EOFError,
        KeyError,
        TypeError,
        pickle.UnpicklingError,
        zipfile.BadZipFile,
        ValueError,
    ) as error:
        raise ArtifactError(
            f"{path}: expected a checkpoint of this version, found a truncated file or "
            f"another format ({error}). Use the other checkpoint of the run, or train again."
        ) from error


def load_weights(model: torch.nn.Module, checkpoint: Checkpoint) -> None:
    """Give the weights of the checkpoint to a model of its configuration.

    Raises:
        ArtifactError: they do not fit, because another version made another model of it.
    """
    try:
        model.load_state_dict(checkpoint.model)
    except RuntimeError as error:
        raise ArtifactError(
            f"checkpoint of step {checkpoint.step}: expected the weights of a model of its "
            f"configuration, found others ({error}). Use the version that trained it, which "
            f"config.json of the run names as revision, or train again. A model with an encoder of "
            f"your own is resumed and exported from Python, with that encoder."
        ) from error


RESTORED = ("step", "skipped", "rate_share", "validation_losses", "running_sums", "running_count")
"""fields of a state that are those of its checkpoint, as they are"""


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
    running_sums: list[float] = field(default_factory=lambda: [0.0] * len(Losses._fields))
    """of the training losses since the last evaluation, in the order of `Losses`"""
    running_count: int = 0
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
        values = torch.stack(losses).detach().tolist()
        self.running_sums = [s + v for s, v in zip(self.running_sums, values, strict=True)]
        self.running_count += 1

    def take_mean_losses(self) -> Losses[float]:
        """Mean training losses since the last call."""
        means = Losses(*(s / max(self.running_count, 1) for s in self.running_sums))
        self.running_sums, self.running_count = [0.0] * len(means), 0
        return means

    def to_checkpoint(
        self, config: TrainingConfig, scaling: Scaling, data_sha256: str
    ) -> Checkpoint:
        """Everything that `restore` needs to continue bit by bit."""
        return Checkpoint(
            config=config,
            scaling=scaling,
            data_sha256=data_sha256,
            model=self.model.state_dict(),
            optimizer=self.optimizer.state_dict(),
            batch_rng=self.rng.get_state(),
            torch_rng=torch.get_rng_state(),
            **{name: copy(getattr(self, name)) for name in RESTORED},
        )

    def restore(self, checkpoint: Checkpoint) -> None:
        """Continue from a checkpoint."""
        load_weights(self.model, checkpoint)
        self.optimizer.load_state_dict(dict(checkpoint.optimizer))
        self.rng.set_state(checkpoint.batch_rng)
        torch.set_rng_state(checkpoint.torch_rng)
        for name in RESTORED:
            setattr(self, name, copy(getattr(checkpoint, name)))
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
