"""A file that exists while a command runs: a task of a cluster cannot be interrupted otherwise.

Each task looks for it before every step; when it is gone, the task saves a checkpoint and ends.
"""

import os
import signal
import threading
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from offline.training.interrupt import stop_on_signals
from rt_controller.contract.errors import ConfigError

FOLDER = "commands"


@dataclass(frozen=True, slots=True)
class RunningCommand:
    """The command that a task belongs to."""

    file: Path
    pid: int

    def is_stopped(self) -> bool:
        """True if it was stopped or has ended; `ConfigError` if this machine lacks the folder."""
        if self.file.exists():
            return False
        if not self.file.parent.is_dir():
            raise ConfigError(
                f"--folder: expected a folder that every worker sees under the same path, found "
                f"no {self.file.parent.parent} on one of them. Share it, and the data set's."
            )
        return True

    def leave_ctrl_c_to_it(self) -> None:
        """Ignore Ctrl-C in a worker process: the command handles it and stops its tasks."""
        if os.getpid() != self.pid and threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def running_command(folder: Path) -> Iterator[RunningCommand]:
    """The command for the tasks of this context; Ctrl-C or SIGTERM stops it.

    Raises:
        ConfigError: the folder cannot be written.
    """
    command = RunningCommand(folder.resolve() / FOLDER / uuid.uuid4().hex, os.getpid())
    try:
        command.file.parent.mkdir(parents=True, exist_ok=True)
        command.file.touch()
    except OSError as error:
        raise ConfigError(
            f"--folder {folder}: expected a writable folder, found: {error.strerror}."
        ) from error
    stop = partial(command.file.unlink, missing_ok=True)
    try:
        with stop_on_signals(stop):
            yield command
    finally:
        stop()
