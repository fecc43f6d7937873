"""The folder of one training run.

config.json    resolved configuration, versions, revision, data set
history.jsonl  one line for each evaluation, without times, so that equal runs write equal files
best.pt        checkpoint of the model to export
last.pt        checkpoint to resume from
"""

import errno
import json
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from offline.config import TrainingConfig
from offline.data.code_identity import source_revision
from offline.files import write_json
from rt_controller.contract.errors import ArtifactError, ConfigError, OutputError
from rt_controller.contract.files import read_text, write_text
from rt_controller.contract.settings_errors import dotted, explain

CONFIG_FILE = "config.json"
HISTORY_FILE = "history.jsonl"
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
        return self.path / HISTORY_FILE

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
    try:
        _make_folder(run)
    except OSError as error:
        raise ConfigError(
            f"{path}: expected to make a new folder for the run, with room for its files, found: "
            f"{error.strerror}. Free some space, or choose another --runs."
        ) from error
    return run


def _make_folder(run: RunFolder) -> None:
    """Make the folder and the link in such an order that a killed process leaves no half a run."""
    base, name = run.path.parent, run.path.name
    if run.path.exists():
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))
    prepared = replace(run, path=base / f".{name}.{os.getpid()}")
    prepared.path.mkdir(parents=True)
    try:
        _write_config(prepared)
        link = base / f".{LATEST_LINK}.{os.getpid()}"
        link.unlink(missing_ok=True)
        link.symlink_to(name)
        os.replace(link, base / LATEST_LINK)
        prepared.path.rename(run.path)
    finally:
        shutil.rmtree(prepared.path, ignore_errors=True)


def open_run(path: Path) -> RunFolder:
    """The run in an existing folder.

    Raises:
        ArtifactError: there is no run, or its config.json is damaged.
    """
    file = path / CONFIG_FILE
    try:
        fields = json.loads(read_text(file))
        run = _RUN.validate_python({**fields, "path": path.resolve()})
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
    _write_config(run)
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
    """Remove the lines of evaluations at or after `step`, which a resumed run writes again."""
    if not run.history.exists():
        return
    lines = run.history.read_text(encoding="utf-8").splitlines()
    kept = [line for line in lines if (at := _step_of(line)) is not None and at < step]
    write_text(run.history, "".join(line + "\n" for line in kept))


def _step_of(line: str) -> int | None:
    """Step of a line; None if the line is incomplete."""
    try:
        return int(json.loads(line)["step"])
    except (ValueError, KeyError, TypeError):
        return None


def _write_config(run: RunFolder) -> None:
    write_json(run.path / CONFIG_FILE, _RUN.dump_python(run, mode="json", exclude={"path"}))
