"""One training run: its folder, its history, and the checkpoints from which it goes on bit by bit.

config.json    resolved configuration, versions, revision, data set
history.jsonl  one line for each evaluation, without times, so that equal runs write equal files
best.pt        checkpoint of the model to export
last.pt        checkpoint to resume from
"""

import fcntl
import json
import os
import pickle
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, replace
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch
from pydantic import TypeAdapter, ValidationError

from offline.config import TrainingConfig
from offline.data.signals import Roles, Scaling
from offline.model.encoder import MakeEncoder
from offline.model.network import MdkNet
from offline.model.observables import sizes_of
from rt_controller.contract.errors import ArtifactError, ConfigError, OutputError
from rt_controller.contract.files import atomic_write, read_text, write_text
from rt_controller.contract.revision import source_revision
from rt_controller.contract.settings_errors import dotted, explain
from rt_controller.contract.signals import Schema

CONFIG_FILE = "config.json"
LATEST_LINK = "latest"


@dataclass(frozen=True, slots=True)
class RunFolder:
    """Paths of a run and the contents of its config.json."""

    path: Path
    config: TrainingConfig
    data_folder: Path
    data_sha256: str
    versions: Mapping[str, str]
    revision: str

    @property
    def best(self) -> Path:
        return self.path / "best.pt"

    @property
    def last(self) -> Path:
        return self.path / "last.pt"

    @property
    def history(self) -> Path:
        return self.path / "history.jsonl"

    @property
    def bundle(self) -> Path:
        return self.path / "bundle"


_RUN = TypeAdapter(RunFolder)


def create_run(
    base: Path, config: TrainingConfig, data_folder: Path, data_sha256: str, now: datetime
) -> RunFolder:
    """A new folder below `base`; the link `base/latest` is set to it.

    Raises:
        ConfigError: the folder cannot be made.
    """
    name = f"{now:%Y%m%d-%H%M%S}-{config.preset}"
    names = (name, *(f"{name}-{k}" for k in range(2, 100)))  # two may begin in one second
    path = next(base / each for each in names if not (base / each).exists())
    versions = {name: version(name) for name in ("rt-controller", "torch", "numpy")}
    run = RunFolder(path, config, data_folder.resolve(), data_sha256, versions, source_revision())
    link = base / f".{LATEST_LINK}.{os.getpid()}"
    try:
        path.mkdir(parents=True)
        rewrite_config(run, config)
        link.unlink(missing_ok=True)
        link.symlink_to(path.name)
        os.replace(link, base / LATEST_LINK)
    except OSError as error:
        raise ConfigError(
            f"{path}: expected to make a new folder for the run, with room for its files, found: "
            f"{error.strerror}. Free some space, or choose another --runs."
        ) from error
    return run


def open_run(path: Path) -> RunFolder:
    """The run in an existing folder.

    Raises:
        ArtifactError: there is no run, or its config.json is damaged or of another version.
    """
    file = path / CONFIG_FILE
    try:
        run = _RUN.validate_python({**json.loads(read_text(file)), "path": path.resolve()})
        if newer := sorted(TrainingConfig.model_fields.keys() - run.config.model_fields_set):
            raise ValueError(f"config without {', '.join(newer)}")
        return run
    except OSError as error:
        raise ArtifactError(
            f"{file}: expected the configuration of a training run, found nothing readable "
            f"({error.strerror}). Train a model with offline-train, or name the folder of a run."
        ) from error
    except (ValueError, TypeError, RecursionError) as error:
        is_refused = isinstance(error, ValidationError)
        reason = explain(error, dotted).rstrip(".") if is_refused else error
        raise ArtifactError(
            f"{file}: expected the configuration of a training run of this version, found "
            f"something else ({reason}). Use the version that the file names as revision, or train "
            f"again with offline-train."
        ) from error


@contextmanager
def training_lock(run: RunFolder) -> Iterator[None]:
    """Within it this process trains the run; the lock is on the folder and leaves no file.

    Raises:
        ConfigError: another process trains it.
    """
    descriptor = os.open(run.path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError as error:
        raise ConfigError(
            f"{run.path}: expected a run that no process trains, found that a training is running "
            f"in it. Wait for its end, or end it with Ctrl-C, which keeps the best model so far."
        ) from error
    finally:
        os.close(descriptor)


def rewrite_config(run: RunFolder, config: TrainingConfig) -> RunFolder:
    """The same run with another configuration, which replaces config.json."""
    run = replace(run, config=config)
    text = _RUN.dump_json(run, indent=2, exclude={"path"}).decode()
    write_text(run.path / CONFIG_FILE, text + "\n")
    return run


def append_history(run: RunFolder, line: Mapping[str, Any]) -> None:
    """Write the line of one more evaluation.

    Raises:
        OutputError: there is no room.
    """
    try:
        with run.history.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")
    except OSError as error:
        raise OutputError(
            f"{run.history}: expected room for another line, found: {error.strerror}. Free some "
            f"space and continue with: offline-train --resume {run.path}"
        ) from error


def cut_history(run: RunFolder, step: int) -> None:
    """Remove incomplete lines, and those at or after `step`, which a resumed run writes again."""

    def is_kept(line: str) -> bool:
        try:
            return int(json.loads(line)["step"]) < step
        except (ValueError, KeyError, TypeError):
            return False

    if run.history.exists():
        lines = run.history.read_text(encoding="utf-8").splitlines()
        write_text(run.history, "".join(line + "\n" for line in lines if is_kept(line)))


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """A run after some steps."""

    step: int
    config: TrainingConfig
    scaling: Scaling
    data_sha256: str
    model: Mapping[str, Any]
    validation_losses: list[float]
    """of all evaluations so far, newest last"""
    training: Mapping[str, Any]
    """optimiser, random generators and `COUNTERS`, from which the run goes on"""


def save_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Replace the file as a whole; a crash leaves the previous checkpoint.

    Raises:
        OutputError: there is no room.
    """
    numbers = asdict(checkpoint.scaling).items()
    content = {
        **{each.name: getattr(checkpoint, each.name) for each in fields(checkpoint)},
        "config": checkpoint.config.model_dump_json(),
        "scaling": {name: torch.from_numpy(array) for name, array in numbers},
    }
    try:
        with atomic_write(path) as stream:
            torch.save(content, stream)
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
        content = torch.load(path, map_location="cpu", weights_only=True)
        content["config"] = TrainingConfig.model_validate_json(content["config"])
        numbers = {name: tensor.numpy() for name, tensor in content["scaling"].items()}
        return Checkpoint(**{**content, "scaling": Scaling(**numbers)})
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
        ValueError,
        pickle.UnpicklingError,
        zipfile.BadZipFile,
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


def restore_model(
    checkpoint: Checkpoint, schema: Schema, roles: Roles, encoder: MakeEncoder | None = None
) -> MdkNet:
    """The model of a checkpoint, in evaluation mode; `encoder` as it was passed to `train`.

    Raises:
        ArtifactError: the weights do not fit, as with another encoder.
    """
    model = MdkNet(checkpoint.config, sizes_of(schema, roles), encoder=encoder)
    load_weights(model, checkpoint)
    return model.eval()
