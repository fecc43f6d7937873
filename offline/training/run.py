"""One training run: its folder, its state, and the checkpoints from which it goes on bit by bit.

config.json    resolved configuration, versions, revision, data set
history.jsonl  one line for each evaluation, without times, so that equal runs write equal files
best.pt        checkpoint of the model to export
last.pt        checkpoint to resume from
"""

import json
import math
import os
import pickle
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from copy import copy
from dataclasses import asdict, dataclass, field, fields, replace
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch
from pydantic import TypeAdapter, ValidationError

from offline.config import TrainingConfig
from offline.data.dataset import Dataset
from offline.data.signals import Roles, Scaling, signal_range
from offline.files import source_revision, write_json
from offline.model.encoder import MakeEncoder
from offline.model.losses import Losses
from offline.model.network import MdkNet
from offline.model.observables import sizes_of
from offline.model.stability import spectral_radius
from offline.training.optimizer import Optimizer
from rt_controller.contract.errors import ArtifactError, ConfigError, OutputError, RtControllerError
from rt_controller.contract.files import atomic_write, read_text, write_text
from rt_controller.contract.settings_errors import dotted, explain
from rt_controller.contract.signals import Schema

CONFIG_FILE = "config.json"
LATEST_LINK = "latest"
MOST_SKIPPED_IN_A_ROW = 50
"""steps that are not taken because the gradient is not finite"""
MOST_RECOVERIES = 6
"""then the learning rate is 1/64 of the configured one"""
COUNTERS = ("skipped", "rate_share", "running")
"""further fields of a state that its checkpoint has too"""


class TrainingDivergedError(RtControllerError):
    """The loss or its gradient is no longer finite, at any learning rate that was tried."""


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
    path = base / f"{now:%Y%m%d-%H%M%S}-{config.preset}"
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


def rewrite_config(run: RunFolder, config: TrainingConfig) -> RunFolder:
    """The same run with another configuration, which replaces config.json."""
    run = replace(run, config=config)
    write_json(run.path / CONFIG_FILE, _RUN.dump_python(run, mode="json", exclude={"path"}))
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
    def learning_rate(self) -> float:
        return self.optimizer.rate

    @learning_rate.setter
    def learning_rate(self, rate: float) -> None:
        self.optimizer.rate = rate

    @property
    def scheduled_rate(self) -> float:
        """The learning rate as it would be if the numbers had always been finite."""
        return self.learning_rate / self.rate_share

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
    model = MdkNet(config, sizes, scaled.float(), encoder).to(device)
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
    state.learning_rate *= 0.5
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
