"""A Linux kernel with CAN as an ordinary process: user-mode Linux, started for one command.

The kernel is that of Debian's package `user-mode-linux`. Its root is the root of this machine, read
only; `guest.py` is its first process.
"""

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

from sim_bridge.plant.library import car_library

REQUIRED = "SOCKETCAN_REQUIRED"
"""name of the variable with which missing programs fail a test instead of skipping it"""
INSTALL = "apt-get install user-mode-linux can-utils iproute2 gcc libc6-dev"
_PROGRAMS = ("linux.uml", "candump", "cansend", "ip", "cc")
_MEMORY_BYTES = 1 << 30
_HERE = Path(__file__).parent


class Finished(NamedTuple):
    """A command that ran in the guest."""

    status: int | None
    """of the command; None: the kernel did not start, or did not come to its end"""
    console: str


def require_programs() -> None:
    """Return if user-mode Linux can be started; else skip the test, or fail it if `REQUIRED`."""
    missing = [name for name in _PROGRAMS if shutil.which(name) is None]
    if not missing:
        return
    message = f"expected {', '.join(missing)}, found no such program. Run: {INSTALL}"
    if os.environ.get(REQUIRED):
        pytest.fail(message)
    pytest.skip(message)


def run(command: list[str], folder: Path, processor_speed: int, timeout_s: float) -> Finished:
    """Run a command on a kernel of its own, with the interface vcan0.

    Args:
        command: a program of this machine and its arguments; it finds a writable folder
            `/run/results`, which is `folder/results` here.
        folder: for the files of the guest; is made.
        processor_speed: how many times as fast as here its processor seems to the guest.
        timeout_s: after this time here the guest is ended.
    """
    results = folder / "results"
    results.mkdir(parents=True)
    car_library()  # compiled here, if it is not yet: the guest cannot write
    library = folder / "host_calls.so"
    source = _HERE / "host_calls.c"
    subprocess.run(["cc", "-shared", "-fPIC", "-O2", "-o", library, source, "-ldl"], check=True)
    init = folder / "init"
    init.write_text(_init_script(command, results), encoding="utf-8")
    init.chmod(0o755)
    kernel = [
        "linux.uml",
        f"mem={_MEMORY_BYTES}",
        "root=/dev/root",
        "rootfstype=hostfs",
        "rootflags=/",
        "ro",
        "lpj=1000000",  # else measured, in the time of the guest
        "quiet",
        "con=null",
        "con0=null,fd:1",
        f"init={init}",
    ]
    environment = {
        **os.environ,
        "LD_PRELOAD": str(library),
        "PROCESSOR_SPEED": str(processor_speed),
        "TMPDIR": str(_memory_folder(folder)),
    }
    try:
        ended = subprocess.run(
            kernel,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=timeout_s,
            check=False,
        )
        console = ended.stdout
    except subprocess.TimeoutExpired as expired:
        console = (expired.stdout or b"") + b"\nended after its time limit"
    status = results / "status"
    found = int(status.read_text()) if status.exists() else None
    return Finished(found, console.decode(errors="replace"))


def _memory_folder(otherwise: Path) -> Path:
    """For the file that is the guest's memory; shared memory is faster, but small in containers."""
    shared = Path("/dev/shm")
    has_room = shared.is_dir() and shutil.disk_usage(shared).free > _MEMORY_BYTES
    return shared if has_room else otherwise


def _init_script(command: list[str], results: Path) -> str:
    """Starts `guest.py`, with the modules beside the kernel, in the folder of these tests."""
    kernel = Path(shutil.which("linux.uml") or "linux.uml").resolve()
    modules = kernel.parents[1] / "lib" / "uml" / "modules"
    repository = _HERE.parents[2]
    guest = [sys.executable, "-S", _HERE / "guest.py", modules, results, repository, *command]
    kept = {
        "PYTHONPATH": str(repository),
        "PATH": os.environ["PATH"],
        "HOME": "/run",
        "TMPDIR": "/run",
    }
    kept |= {"PYTHONDONTWRITEBYTECODE": "1", "LANG": "C.UTF-8"}
    lines = [f"export {name}={shlex.quote(value)}" for name, value in kept.items()]
    return "\n".join(("#!/bin/sh", *lines, f"exec {shlex.join(map(str, guest))}", ""))
