"""The folder of one training run: what was asked for, on what, and how it went.

config.json    resolved configuration, versions, revision, data set
history.jsonl  one line an evaluation; no times in it, so equal runs write equal files
best.pt        the model to export
last.pt        where to resume
"""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from offline.checkpoint import BEST_FILE, LAST_FILE
from offline.config import TrainingConfig, restore_config
from offline.revision import source_revision
from rt_controller.contract.errors import ArtifactError, ConfigError, RtControllerError

CONFIG_FILE = "config.json"
HISTORY_FILE = "history.jsonl"
LATEST_LINK = "latest"


@dataclass(frozen=True, slots=True)
class RunFolder:
    """Paths of a run and the configuration written there."""

    path: Path
    config: TrainingConfig
    data_folder: Path
    data_sha256: str
    versions: Mapping[str, str]
    revision: str

    @property
    def best(self) -> Path:
        return self.path / BEST_FILE

    @property
    def last(self) -> Path:
        return self.path / LAST_FILE

    @property
    def history(self) -> Path:
        return self.path / HISTORY_FILE

    @property
    def bundle(self) -> Path:
        return self.path / "bundle"


def create_run(
    base: Path, config: TrainingConfig, data_folder: Path, data_sha256: str, now: datetime
) -> RunFolder:
    """A new folder below `base`, which `base/latest` then points to."""
    path = base / f"{now:%Y%m%d-%H%M%S}-{config.preset}"
    try:
        path.mkdir(parents=True)
    except OSError as error:
        raise ConfigError(
            f"{path}: expected to make a new folder for the run, found: {error.strerror}. Choose "
            f"another --runs."
        ) from error
    versions = {name: version(name) for name in ("rt-controller", "torch", "numpy")}
    run = RunFolder(path, config, data_folder.resolve(), data_sha256, versions, source_revision())
    _write_config(run)
    link = base / f".{LATEST_LINK}.{os.getpid()}"
    link.symlink_to(path.name)
    os.replace(link, base / LATEST_LINK)
    return run


def open_run(path: Path) -> RunFolder:
    """A run that was created before.

    Raises:
        ArtifactError: there is no run in that folder, or its configuration is not readable.
    """
    file = path / CONFIG_FILE
    try:
        fields = json.loads(file.read_text(encoding="utf-8"))
        return RunFolder(
            path=path.resolve(),
            config=restore_config(fields["config"]),
            data_folder=Path(fields["data_folder"]),
            data_sha256=str(fields["data_sha256"]),
            versions=dict(fields["versions"]),
            revision=str(fields["revision"]),
        )
    except OSError as error:
        raise ArtifactError(
            f"{file}: expected the configuration of a training run, found nothing readable "
            f"({error.strerror}). Train a model with offline-train, or name the folder of a run."
        ) from error
    except (ValueError, KeyError, TypeError) as error:
        raise ArtifactError(
            f"{file}: expected the configuration of a training run of this version, found "
            f"something else ({error}). Train again with offline-train."
        ) from error


def rewrite_config(run: RunFolder, config: TrainingConfig) -> RunFolder:
    """The same run with another configuration, written down."""
    rewritten = replace(run, config=config)
    _write_config(rewritten)
    return rewritten


def append_history(run: RunFolder, line: Mapping[str, Any]) -> None:
    """One more evaluation."""
    try:
        with run.history.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")
    except OSError as error:
        raise RtControllerError(
            f"{run.history}: expected room for another line, found: {error.strerror}. Free some "
            f"space and go on with: offline-train --resume {run.path}"
        ) from error


def cut_history(run: RunFolder, step: int) -> None:
    """Forget evaluations at or after `step`: they will be made, and written, again."""
    if not run.history.exists():
        return
    lines = run.history.read_text(encoding="utf-8").splitlines()
    kept = [line for line in lines if (at := _step_of(line)) is not None and at < step]
    part = run.history.with_name(HISTORY_FILE + ".part")
    part.write_text("".join(line + "\n" for line in kept), encoding="utf-8")
    os.replace(part, run.history)


def _step_of(line: str) -> int | None:
    """None for a line that a power cut left half written."""
    try:
        return int(json.loads(line)["step"])
    except (ValueError, KeyError, TypeError):
        return None


def _write_config(run: RunFolder) -> None:
    fields = {
        "config": run.config.model_dump(mode="json"),
        "data_folder": str(run.data_folder),
        "data_sha256": run.data_sha256,
        "versions": dict(run.versions),
        "revision": run.revision,
    }
    part = run.path / (CONFIG_FILE + ".part")
    part.write_text(json.dumps(fields, indent=2) + "\n", encoding="utf-8")
    os.replace(part, run.path / CONFIG_FILE)
