"""Tools of python-can and cantools beside a drive, on each bus between processes."""

import io
import json
import os
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass

import cantools
import pytest
from processes import program, start_bus_server
from slcan_hub import SlcanHub
from terminal_tool import TerminalTool

from benchmarks.cadence import start
from rt_controller.bus.dbc import DBC_PATH
from rt_controller.bus.messages import CATALOGUE, Node
from rt_controller.bus.receive import Inbox
from rt_controller.bus.transport import close_bus, open_bus
from rt_controller.model.artifact import shipped_model

PATIENCE_S = 300.0
DRIVE_S = 3.0
SAFE_STOPPED, VEHICLE_BRAKED = 6, 5
SCENARIO = f'format = 2\nname = "straight"\nduration_s = {DRIVE_S}\nreference.speed_kmh = 30.0\n'
CAN_LOGGER = (
    "import signal, can.logger; "
    "signal.signal(signal.SIGINT, signal.default_int_handler); "  # background jobs ignore it
    "can.logger.main()"
)


@dataclass(frozen=True, slots=True)
class SharedBus:
    """A bus that processes of this machine share, and how each of them opens it."""

    interface: str
    channels: Iterator[str]
    """one for each process"""

    def tool_options(self):
        return ("-i", self.interface, "-c", next(self.channels))

    def program_options(self):
        return ("--bus", self.interface, "--channel", next(self.channels))


def _always(channel):
    while True:
        yield channel


@pytest.fixture(params=["local", "remote", "slcan"])
def bus(request, tmp_path):
    with ExitStack() as running:
        if request.param == "local":
            channels = _always(f"tools-{uuid.uuid4().hex}")
        elif request.param == "remote":
            pytest.importorskip("can_remote", reason="the extra [remote] is not installed")
            channels = _always(start_bus_server(tmp_path / "server.log", running)[1])
        else:
            pytest.importorskip("serial", reason="pyserial is not installed")
            channels = iter(running.enter_context(SlcanHub(7)).ports)
        yield SharedBus(request.param, channels)


def run_tool(main, *arguments, monkeypatch):
    monkeypatch.setattr(sys, "argv", list(arguments))
    main()


@pytest.mark.nightly
def test_tools_read_a_drive_and_play_it_again(bus, tmp_path, monkeypatch, capsys):
    log = tmp_path / "bus.log"
    found = drive_beside_tools(bus, tmp_path, log)
    # Beside three tools, states may arrive 50 ms late on two busy cores: a safe stop is allowed.
    assert found["ey_peak_m"] < 0.1
    assert found["frames_received"]["crc_errors"] == 0
    assert found["frames_received"]["wrong_sequence"] == 0

    capsys.readouterr()
    with monkeypatch.context() as patched:
        patched.setattr(sys, "stdin", io.StringIO(log.read_text()))
        arguments = ("decode", "--single-line", str(DBC_PATH))
        run_tool(cantools._main, "cantools", *arguments, monkeypatch=patched)
    decoded = capsys.readouterr().out
    for message in CATALOGUE.messages:
        for codec in message.codecs:
            assert f"{codec.name}(" in decoded
    assert "Unknown" not in decoded

    states = [line for line in log.read_text().splitlines() if " 11" in line][:120]
    played = tmp_path / "states.log"
    played.write_text("\n".join(states) + "\n")
    reader = open_bus(bus.interface, next(bus.channels))
    with ExitStack() as running:
        running.callback(close_bus, reader)
        player = (sys.executable, "-m", "can.player", *bus.tool_options(), str(played))
        running.enter_context(subprocess.Popen(player, stdout=subprocess.DEVNULL))
        inbox, read, give_up = Inbox(Node.CONTROLLER), 0, time.monotonic() + PATIENCE_S
        while read < len(states) and time.monotonic() < give_up:
            read += inbox.drain(reader, 0)
        assert (read, inbox.counts.crc_errors) == (len(states), 0)


def drive_beside_tools(bus, folder, log):
    """The controller's summary of a short drive, which logger, viewer and monitor have read."""
    summary, scenario = folder / "controller.json", folder / "straight.toml"
    scenario.write_text(SCENARIO)
    tool = (sys.executable, "-m")
    with ExitStack() as running:
        logger = start(
            *(sys.executable, "-c", CAN_LOGGER, *bus.tool_options(), "-f", str(log)),
            log=folder / "logger.log",
            running=running,
        )
        viewer = running.enter_context(TerminalTool(*tool, "can.viewer", *bus.tool_options()))
        monitor = running.enter_context(
            TerminalTool(*tool, "cantools", "monitor", *bus.tool_options(), DBC_PATH)
        )
        viewer.wait_for(b"Count")
        monitor.wait_for(b"Received: 0")
        wait_for_file(log, logger)
        car = start(
            *program("sim_bridge.cli", *bus.program_options(), "--scenario", str(scenario)),
            log=folder / "car.log",
            running=running,
        )
        options = ("--wait-s", "90", "--max-misses", "1000000")
        model = ("--model", str(shipped_model("lti")), "--realtime.deadline-ms", "25")
        controller = start(
            *program("rt_controller.cli", *bus.program_options(), *model, *options),
            *("--json", str(summary)),
            log=folder / "controller.log",
            running=running,
        )
        ended = controller.wait(PATIENCE_S)
        assert ended in (0, SAFE_STOPPED), (folder / "controller.log").read_text()
        assert car.wait(PATIENCE_S) in (0, VEHICLE_BRAKED), (folder / "car.log").read_text()
        viewer.wait_for(b"0x100", b"0x110", b"0x130", b"0x180")
        monitor.wait_for(b"VelocityX", b"Throttle")
        assert viewer.press(b"q") == 0
        assert monitor.press(b"q") == 0
        logger.send_signal(signal.SIGINT)
        assert logger.wait(PATIENCE_S) == 0, (folder / "logger.log").read_text()
    return json.loads(summary.read_text())


def wait_for_file(path, writer):
    give_up = time.monotonic() + PATIENCE_S
    while not os.path.exists(path):
        assert writer.poll() is None
        assert time.monotonic() < give_up, f"expected the file {path} of a running can_logger"
        time.sleep(0.05)
