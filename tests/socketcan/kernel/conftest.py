"""Two sockets on the bus of the running kernel, and a foreign program."""

import subprocess
from collections.abc import Iterator

import can
import pytest
from kernel_bus import CHANNEL

from rt_controller.bus.transport import open_bus


@pytest.fixture
def near() -> Iterator[can.BusABC]:
    """The bus as the programs open it."""
    with open_bus("socketcan", CHANNEL) as bus:
        yield bus


@pytest.fixture
def far() -> Iterator[can.BusABC]:
    """A second socket on the same bus, that of the other node."""
    with open_bus("socketcan", CHANNEL) as bus:
        yield bus


@pytest.fixture
def foreign_log() -> Iterator["subprocess.Popen[str]"]:
    """candump, a C program of can-utils, on the same bus; it prints one frame a line."""
    command = ["candump", "-L", f"{CHANNEL},0:0,#FFFFFFFF"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as dump:
        yield dump
        dump.terminate()
