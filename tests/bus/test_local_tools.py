"""Tools of python-can and cantools read a local bus beside a drive."""

import fcntl
import os
import pty
import signal
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path

import can
from made_frames import SAMPLE

from rt_controller.bus.catalogue import STATE
from rt_controller.bus.dbc import DBC_PATH
from rt_controller.bus.message import Node
from rt_controller.bus.outbox import Outbox
from rt_controller.bus.transport import open_bus

CHANNEL = f"tools-{os.getpid()}"
BUS_OPTIONS = ("-i", "local", "-c", CHANNEL)
TIMEOUT_S = 60.0
CAN_LOGGER = (
    "import signal, can.logger\n"
    "# A shell lets the programs that it starts in the background ignore Ctrl-C.\n"
    "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    "can.logger.main()"
)


def test_can_logger_and_cantools_monitor_read_along(tmp_path: Path) -> None:
    log = tmp_path / "drive.log"
    terminal, tools_end = pty.openpty()
    fcntl.ioctl(tools_end, termios.TIOCSWINSZ, struct.pack("HHHH", 50, 120, 0, 0))
    os.set_blocking(terminal, False)
    tool = [sys.executable, "-m"]
    logger = subprocess.Popen(
        [sys.executable, "-c", CAN_LOGGER, *BUS_OPTIONS, "--filter", "110:7FF", "-f", log]
    )
    monitor = subprocess.Popen(
        [*tool, "cantools", "monitor", *BUS_OPTIONS, DBC_PATH],
        stdin=tools_end,
        stdout=tools_end,
        env={**os.environ, "TERM": "xterm"},
    )
    shown = b""
    try:
        with open_bus("local", CHANNEL) as bus:
            outbox = Outbox(bus, Node.VEHICLE)
            until = time.monotonic() + TIMEOUT_S
            while time.monotonic() < until:
                outbox.send(STATE, SAMPLE, 0)
                shown += _read(terminal)
                if b"VelocityX: 20.0 m/s" in shown and log.exists() and log.stat().st_size > 0:
                    break
                time.sleep(0.01)
        os.write(terminal, b"q")
        logger.send_signal(signal.SIGINT)
        assert monitor.wait(TIMEOUT_S) == 0
        assert logger.wait(TIMEOUT_S) == 0
    finally:
        for process in (logger, monitor):
            process.kill()
            process.wait()
    assert b"VelocityX: 20.0 m/s" in shown
    logged = list(can.CanutilsLogReader(log))
    assert {message.arbitration_id for message in logged} == {0x110}
    assert all(STATE.codecs[0].is_intact(message.data) for message in logged)


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 65_536)
    except BlockingIOError:
        return b""
