"""Programs in processes of their own."""

import os
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path


def program(module: str, *arguments: str) -> list[str]:
    """The command that runs the `main` of a module."""
    code = f"import sys; from {module} import main; sys.argv[0] = '{module}'; main()"
    return [sys.executable, "-c", code, *arguments]


def start(
    *command: str, log: Path, running: ExitStack, cpu: int | None = None
) -> subprocess.Popen[bytes]:
    """The process, on one core if `cpu` is given, which ends with `running`."""
    pinned = () if cpu is None else ("taskset", "-c", str(cpu))
    environment = {**os.environ, "COLUMNS": "200"}
    with log.open("wb") as output:
        process = subprocess.Popen(
            [*pinned, *command], stdout=output, stderr=output, env=environment
        )
    running.callback(process.wait)
    running.callback(process.kill)
    return process
