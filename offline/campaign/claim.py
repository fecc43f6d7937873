"""One worker for one folder, for as long as that worker lives.

A task may be given out twice: by a cluster that took a slow worker for a dead one, by a second
command, or while the worker of a dead command still trains. The folder then belongs to whoever
holds its lock, and the system takes the lock away from a process that dies.
"""

import fcntl
import os
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

FILE = "claim"
WAIT_S = 0.2


@contextmanager
def claimed(folder: Path, give_up: Callable[[], bool]) -> Iterator[bool]:
    """Whether the folder is one's own within the context.

    Waits while somebody else has it, until `give_up` says otherwise; then it is not.
    """
    file = os.open(folder / FILE, os.O_RDWR | os.O_CREAT)
    try:
        is_ours = _lock(file)
        while not is_ours and not give_up():
            time.sleep(WAIT_S)
            is_ours = _lock(file)
        if is_ours:
            os.ftruncate(file, 0)
            os.pwrite(file, f"{os.getpid()} on {socket.gethostname()}\n".encode(), 0)
        yield is_ours
    finally:
        os.close(file)  # and the lock with it


def _lock(file: int) -> bool:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
