"""Controller and car, two processes with periods of 25 ms, on a bus of the kernel."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

import pytest
from kernel_bus import CHANNEL, switch

from rt_controller.bus.messages import CATALOGUE
from rt_controller.contract.timing import IDENT_PERIOD_TICKS, PERIOD_S
from rt_controller.model.artifact import shipped_model

PATIENCE_S = 120.0
EXIT_BUS = 5
FD_FRAME = "124##1AABB"
BUS_OFF_FRAME = "20000040#0000000000000000"
"""as a driver reports it; the frames that follow say that the bus works again"""


@dataclass(slots=True)
class Drive:
    """The processes, and their files."""

    folder: Path
    running: ExitStack

    def start(self, name: str, module: str, *options: str) -> "subprocess.Popen[bytes]":
        call = f"import sys; from {module} import main; sys.argv[0] = {name!r}; main()"
        bus = ("--bus", "socketcan", "--channel", CHANNEL)
        summary = ("--json", str(self.folder / f"{name}.json"))
        with (self.folder / f"{name}.log").open("wb") as log:
            process = subprocess.Popen(
                [sys.executable, "-c", call, *bus, *summary, *options],
                stdout=log,
                stderr=subprocess.STDOUT,
            )
        self.running.callback(process.kill)
        return process

    def start_car(self, duration_s: float) -> "subprocess.Popen[bytes]":
        scenario = self.folder / "straight.toml"
        scenario.write_text(
            f'format = 2\nname = "straight"\nduration_s = {duration_s}\n'
            f"reference.speed_kmh = 30.0\n"
        )
        return self.start("car", "sim_bridge.cli", "--scenario", str(scenario))

    def start_controller(self) -> "subprocess.Popen[bytes]":
        # What is late here says nothing about a vehicle.
        late = ("--realtime.deadline-ms", "25", "--max-misses", "1000000")
        options = (*late, "--wait-s", "60")
        model = ("--model", str(shipped_model("lti")))
        return self.start("controller", "rt_controller.cli", *model, *options)

    def log(self, name: str) -> str:
        return (self.folder / f"{name}.log").read_text(errors="replace")

    def summary(self, name: str) -> dict[str, Any]:
        found: dict[str, Any] = json.loads((self.folder / f"{name}.json").read_text())
        return found


def wait_until(condition: Callable[[], bool], what: str) -> None:
    give_up = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < give_up, f"expected {what} within {PATIENCE_S:g} s"
        time.sleep(0.1)


def times_s(recorded: Path, identifier: str) -> list[float]:
    """When candump received the frames of this identifier."""
    lines = recorded.read_text().splitlines()
    return [float(line[1 : line.index(")")]) for line in lines if f" {identifier}#" in line]


@pytest.fixture
def drive(tmp_path: Path) -> Iterator[Drive]:
    with ExitStack() as running:
        yield Drive(tmp_path, running)


def test_two_processes_drive_and_a_foreign_program_records_all_of_it(drive: Drive) -> None:
    recorded = drive.folder / "candump.log"
    with recorded.open("wb") as file:
        dump = subprocess.Popen(["candump", "-L", f"{CHANNEL},0:0,#FFFFFFFF"], stdout=file)
    drive.running.callback(dump.kill)
    car, controller = drive.start_car(4.0), drive.start_controller()
    wait_until(lambda: "NOMINAL" in drive.log("controller"), "a driving controller")
    for frame in ("555#00112233", "18DAF110#0210", "7FF#R", FD_FRAME, BUS_OFF_FRAME):
        subprocess.run(["cansend", CHANNEL, frame], check=True)
    assert car.wait(PATIENCE_S) == 0, drive.log("car")
    assert controller.wait(PATIENCE_S) == 0, drive.log("controller")
    dump.send_signal(signal.SIGINT)
    dump.wait(PATIENCE_S)
    found = drive.summary("controller")
    assert (found["ending"], found["final_mode"]) == ("MISSION_OVER", "STANDBY")
    assert found["ey_peak_m"] < 0.1
    assert found["send_failures"] == 0
    assert (found["bus_condition"]["bus_off"], found["bus_condition"]["state"]) == (1, "ACTIVE")
    assert found["frames_received"]["overflowed"] == 0
    steps_s = [after - before for before, after in pairwise(times_s(recorded, "100"))]
    assert median(steps_s) == pytest.approx(PERIOD_S, abs=1e-3)
    ids = [line.split()[-1].partition("#")[0] for line in recorded.read_text().splitlines()]
    for codec in (codec for message in CATALOGUE.messages for codec in message.codecs):
        assert ids.count(f"{codec.arbitration_id:03X}") >= 4.0 / PERIOD_S / IDENT_PERIOD_TICKS / 2
    assert ids.count("18DAF110") == 1


def test_a_link_that_is_down_for_a_moment_ends_in_a_safe_stop_that_names_it(drive: Drive) -> None:
    car, controller = drive.start_car(60.0), drive.start_controller()
    wait_until(lambda: "NOMINAL" in drive.log("controller"), "a driving controller")
    switch("down")
    time.sleep(0.5)
    switch("up")
    assert controller.wait(PATIENCE_S) == EXIT_BUS, drive.log("controller")
    assert car.wait(PATIENCE_S) in (0, EXIT_BUS), drive.log("car")
    found = drive.summary("controller")
    assert (found["ending"], found["stop_cause"]) == ("SAFE_STOPPED", "INTERFACE_DOWN")
    assert found["bus_condition"]["link_downs"] == 1
    assert found["bus_condition"]["state"] == "ACTIVE"
    assert "interface is down" in drive.log("controller")
    assert drive.summary("car")["final_speed_mps"] < 0.3
