"""Checkpoints: all that a training run needs to go on as if it had never stopped.

Written whole or not at all, read without pickles (`weights_only`).
"""

import json
import os
import pickle
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch

from offline.config import TrainingConfig, restore_config
from offline.scaling import Scaling
from rt_controller.contract.errors import ArtifactError, RtControllerError

BEST_FILE = "best.pt"
LAST_FILE = "last.pt"


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
    """steps whose gradient was not finite and that were therefore not taken"""


def save_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Replace the file at once: a reader, or a power cut, meets the old one or the new one."""
    part = path.with_name(path.name + ".part")
    fields = {name: getattr(checkpoint, name) for name in Checkpoint.__dataclass_fields__}
    fields["config"] = checkpoint.config.model_dump_json()
    fields["scaling"] = {
        name: torch.from_numpy(array) for name, array in asdict(checkpoint.scaling).items()
    }
    try:
        torch.save(fields, part)
        os.replace(part, path)
    except (OSError, RuntimeError) as error:
        part.unlink(missing_ok=True)
        raise RtControllerError(
            f"{path}: expected room for a checkpoint, found: {error}. The previous checkpoint is "
            f"untouched: free some space and resume the run."
        ) from error


def load_checkpoint(path: Path) -> Checkpoint:
    """Read a checkpoint.

    Raises:
        ArtifactError: there is none, or the file is truncated or of another program.
    """
    try:
        fields = torch.load(path, map_location="cpu", weights_only=True)
        fields["config"] = restore_config(json.loads(fields["config"]))
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
            f"{path}: expected a checkpoint of this version, found a truncated or foreign file "
            f"({error}). Use the other checkpoint of the run, or train again."
        ) from error
