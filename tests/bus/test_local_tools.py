"""Tools of python-can and cantools read a local bus beside a drive."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import can
import pytest
from made_frames import SAMPLE
from terminal_tool import TerminalTool

from rt_controller.bus.dbc import DBC_PATH
from rt_controller.bus.messages import STATE, Node
from rt_controller.bus.send import Outbox
from rt_controller.bus.transport import open_bus

CHANNEL = f"tools-{os.getpid()}"
BUS_OPTIONS = ("-i", "local", "-c", CHANNEL)
TIMEOUT_S = 60.0
PYTHON = sys.executable
CAN_LOGGER = (
    "import signal, can.logger\n"
    "# A shell lets the programs that it starts in the background ignore Ctrl-C.\n"
    "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    "can.logger.main()"
)


@pytest.fixture
def _sent_states() -> Iterator[None]:
    """A vehicle that sends its state all the time."""
    is_ending = threading.Event()

    def send() -> None:
        with open_bus("local", CHANNEL) as bus:
            outbox = Outbox(bus, Node.VEHICLE)
            while not is_ending.wait(0.01):
                outbox.send(STATE, SAMPLE, 0)

    vehicle = threading.Thread(target=send)
    vehicle.start()
    yield
    is_ending.set()
    vehicle.join()


@pytest.mark.usefixtures("_sent_states")
def test_can_logger_can_viewer_and_cantools_monitor_read_along(tmp_path: Path) -> None:
    log = tmp_path / "drive.log"
    with ExitStack() as running:
        logger = subprocess.Popen(
            [PYTHON, "-c", CAN_LOGGER, *BUS_OPTIONS, "--filter", "110:7FF", "-f", log]
        )
        running.callback(logger.wait)
        running.callback(logger.kill)
        viewer = running.enter_context(TerminalTool(PYTHON, "-m", "can.viewer", *BUS_OPTIONS))
        monitor = running.enter_context(
            TerminalTool(PYTHON, "-m", "cantools", "monitor", *BUS_OPTIONS, DBC_PATH)
        )
        viewer.wait_for(b"0x110", b"0x111", b"0x112")
        monitor.wait_for(b"VelocityX: 20.0 m/s")
        assert viewer.press(b"q") == 0
        assert monitor.press(b"q") == 0
        give_up = time.monotonic() + TIMEOUT_S
        while not (log.exists() and log.stat().st_size > 0) and time.monotonic() < give_up:
            time.sleep(0.02)
        logger.send_signal(signal.SIGINT)
        assert logger.wait(TIMEOUT_S) == 0
    logged = list(can.CanutilsLogReader(log))
    assert {message.arbitration_id for message in logged} == {0x110}
    assert all((STATE.codecs[0].check(message.data) >= 0) for message in logged)
