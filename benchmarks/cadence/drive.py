"""One drive: a car and a controller, each a process of its own, and a bus between them."""

import json
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cadence.pool import Ticks
from benchmarks.cadence.weave import write_weave
from rt_controller.contract.errors import BusError
from rt_controller.outcome import StopCause

PATIENCE_S = 60.0
STANDSTILL = (
    StopCause.STATE_LOST.name,
    StopCause.REFERENCE_LOST.name,
    StopCause.MISSION_LOST.name,
    StopCause.VEHICLE_BRAKING.name,
)
"""why a drive stops when the machine does not run its processes for a while"""


class Transport(StrEnum):
    """Of the frames, from process to process."""

    LOCAL = "local"
    """through shared memory"""
    REMOTE = "remote"
    """python-can-remote: a server in the middle"""


def drive(
    ticks: int, options: Sequence[str], transport: Transport, car_cpu: int, controller_cpu: int
) -> tuple[dict[str, Any], Ticks]:
    """The controller's own summary of a weave of so many ticks, and the times of each.

    The car, and a server if there is one, share a core; the other one is the controller's. Where
    the machine stands still for long, the drive ends in a safe stop before its time.

    Raises:
        BusError: it ended in any other way.
    """
    with tempfile.TemporaryDirectory() as name, ExitStack() as running:
        folder = Path(name)
        write_weave(folder / "weave.toml", ticks)
        port = _free_port()
        channel = f"cadence-{port}"
        if transport is Transport.REMOTE:
            server = _start(
                *(sys.executable, "-m", "can_remote", "-H", "127.0.0.1", "-p", str(port)),
                *("-i", "virtual", "-c", channel, "-b", "500000"),
                log=folder / "bus.log",
                cpu=car_cpu,
                running=running,
            )
            _await_listener(port, server)
            channel = f"ws://127.0.0.1:{port}/"
        bus = ("--bus", transport.value, "--channel", channel, "--quiet")
        _start(
            *_program("sim_bridge.cli", *bus, "--scenario", str(folder / "weave.toml")),
            log=folder / "car.log",
            cpu=car_cpu,
            running=running,
        )
        controller = _start(
            *_program("rt_controller.cli", *bus, "--realtime.cpu", str(controller_cpu)),
            *("--json", str(folder / "controller.json")),
            *("--ticks", str(folder / "ticks.csv"), *options),
            log=folder / "controller.log",
            cpu=None,
            running=running,
        )
        controller.wait(ticks * 0.025 + PATIENCE_S)
        if not (folder / "controller.json").exists():
            raise BusError((folder / "controller.log").read_text()[-1000:])
        summary: dict[str, Any] = json.loads((folder / "controller.json").read_text())
        if summary["ending"] != "MISSION_OVER" and summary["stop_cause"] not in STANDSTILL:
            raise BusError(
                f"expected a drive to its end, found {summary['ending']} after "
                f"{summary['ticks']} ticks.\n{(folder / 'car.log').read_text()[-1000:]}"
            )
        ticks_seen = np.genfromtxt(folder / "ticks.csv", delimiter=",", names=True)
        return summary, np.atleast_1d(ticks_seen)


def _program(module: str, *arguments: str) -> list[str]:
    text = f"import sys; from {module} import main; sys.argv[0] = '{module}'; main()"
    return [sys.executable, "-c", text, *arguments]


def _start(
    *command: str, log: Path, cpu: int | None, running: ExitStack
) -> subprocess.Popen[bytes]:
    where = () if cpu is None else ("taskset", "-c", str(cpu))
    output = running.enter_context(log.open("wb"))
    process = subprocess.Popen([*where, *command], stdout=output, stderr=output)
    running.callback(process.wait)
    running.callback(process.kill)
    return process


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def _await_listener(port: int, server: subprocess.Popen[bytes]) -> None:
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until and server.poll() is None:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.05)
    raise BusError(f"expected a bus server on 127.0.0.1:{port}, found none.")
