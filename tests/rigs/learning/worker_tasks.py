"""Tasks for workers: they leave a trace, wait, or kill their own process when a file says so."""

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from offline.experiments.running_command import RunningCommand, running_command

DIE_FILE = "die"


def square(number: int) -> int:
    return number * number


def square_with_trace(number: int, folder: Path) -> int:
    """Writes NUMBER.PID, then waits while the file hold-NUMBER exists."""
    (folder / f"{number}.{os.getpid()}").touch()
    while (folder / f"hold-{number}").exists():
        time.sleep(0.01)
    return number * number


def square_or_die(number: int, folder: Path) -> int:
    """Kills its process if die-NUMBER exists: once if it is a file, always if it is a folder."""
    kill_own_process_if(folder / f"die-{number}")
    return number * number


def fail(number: int) -> int:
    raise ValueError(f"{number} is too much")


def kill_own_process_if(told: Path) -> None:
    if told.is_file():
        try:
            told.unlink()
        except FileNotFoundError:  # another worker was faster
            return
    elif not told.is_dir():
        return
    os.kill(os.getpid(), signal.SIGKILL)


class DeadlyCommand(RunningCommand):
    """Kills one worker, between two steps after the first checkpoint, if the folder has `die`."""

    def is_stopped(self) -> bool:
        folder = self.file.parent.parent
        if any(folder.rglob("last.pt")):
            kill_own_process_if(folder / DIE_FILE)
        return super().is_stopped()


@contextmanager
def deadly_command(folder: Path) -> Iterator[RunningCommand]:
    with running_command(folder) as command:
        (folder / DIE_FILE).touch()
        yield DeadlyCommand(command.file, command.pid)
