"""Tasks that leave a trace of who did them, and wait or die when told to."""

import os
import signal
import time
from pathlib import Path


def square(number: int) -> int:
    return number * number


def square_with_trace(number: int, folder: Path) -> int:
    """Writes NUMBER.PID, then waits as long as there is a file hold-NUMBER."""
    (folder / f"{number}.{os.getpid()}").touch()
    while (folder / f"hold-{number}").exists():
        time.sleep(0.01)
    return number * number


def square_or_die(number: int, folder: Path) -> int:
    """Dies of SIGKILL where there is a die-NUMBER: once if it is a file, always if a folder."""
    omen = folder / f"die-{number}"
    if omen.exists():
        if omen.is_file():
            omen.unlink()
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def fail(number: int) -> int:
    raise ValueError(f"{number} is too much")
