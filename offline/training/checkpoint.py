"""Checkpoints: all that a resumed run needs to continue bit by bit. Read without pickles."""

import pickle
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch

from offline.config import TrainingConfig
from offline.data.signals import Scaling
from rt_controller.contract.errors import ArtifactError, OutputError
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
