"""Programs in processes of their own, and a server for a bus between them."""

import socket
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

from benchmarks.cadence import start
from rt_controller.contract.errors import BusError

SERVER_TIMEOUT_S = 60.0


def program(module: str, *arguments: str) -> list[str]:
    """The command that runs the `main` of a module."""
    code = f"import sys; from {module} import main; sys.argv[0] = '{module}'; main()"
    return [sys.executable, "-c", code, *arguments]


def start_bus_server(log: Path, running: ExitStack) -> tuple[subprocess.Popen[bytes], str]:
    """A server of python-can-remote that listens, and the channel of its bus.

    Raises:
        BusError: it does not listen in time.
    """
    with socket.socket() as probe:  # the system chooses a free port
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    server = start(
        *(sys.executable, "-m", "can_remote", "-H", "127.0.0.1", "-p", str(port)),
        *("-i", "virtual", "-c", f"server-{port}", "-b", "500000"),
        log=log,
        running=running,
    )
    until = time.monotonic() + SERVER_TIMEOUT_S
    while time.monotonic() < until and server.poll() is None:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return server, f"ws://127.0.0.1:{port}/"
        time.sleep(0.05)
    raise BusError(
        f"Expected a bus server on 127.0.0.1:{port}, found none.\n{log.read_text()[-1000:]}"
    )
