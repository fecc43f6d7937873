"""The will of a command that its tasks go on, as a file that every worker sees.

A worker may be anywhere, and a running task cannot be called back through a cluster. So a task
looks for the file of the command that wanted it, about once a second, and stops where nothing is
lost when it is gone.
"""

import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from offline.interrupt import stop_on_signals
from rt_controller.contract.errors import ConfigError

FOLDER = "attempts"
LOOK_S = 1.0
LISTEN_S = 0.1


@dataclass(frozen=True, slots=True)
class Attempt:
    """One command at work on a campaign's folder."""

    file: Path

    def is_wanted(self) -> bool:
        """Whether the command still wants its tasks done.

        Raises:
            ConfigError: the campaign's folder cannot be seen from here.
        """
        if self.file.exists():
            return True
        if not self.file.parent.is_dir():
            raise ConfigError(
                f"--folder: expected a folder that every worker sees under the same path, found "
                f"no {self.file.parent.parent} on one of them. Share it, and the data set's."
            )
        return False

    def should_stop(self) -> Callable[[], bool]:
        """Whether to stop, for a training loop to ask at every step."""
        looked_s = -LOOK_S
        stop = False

        def ask() -> bool:
            nonlocal looked_s, stop
            now_s = time.monotonic()
            if not stop and now_s - looked_s >= LOOK_S:
                looked_s, stop = now_s, not self.is_wanted()
            return stop

        return ask


@contextmanager
def attempt(folder: Path) -> Iterator[Attempt]:
    """An attempt that lasts as long as the context, or until Ctrl-C or a polite kill.

    Raises:
        ConfigError: the folder cannot be made.
    """
    current = Attempt(folder.resolve() / FOLDER / uuid.uuid4().hex)
    try:
        current.file.parent.mkdir(parents=True, exist_ok=True)
        current.file.touch()
    except OSError as error:
        raise ConfigError(
            f"--folder {folder}: expected a folder that can be written, found: {error.strerror}."
        ) from error
    over = threading.Event()
    with stop_on_signals() as stop_requested:

        def listen() -> None:
            while not stop_requested() and not over.wait(LISTEN_S):
                pass
            current.file.unlink(missing_ok=True)

        listener = threading.Thread(target=listen, daemon=True)
        listener.start()
        try:
            yield current
        finally:
            over.set()
            listener.join()
