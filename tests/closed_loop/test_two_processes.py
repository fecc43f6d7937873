"""Controller and car in two processes, on a bus of this machine, in real time."""

import json
import signal
import subprocess
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from benchmarks.processes import program, start, start_bus_server
from rt_controller.model.artifact import shipped_model

PATIENCE_S = 90.0


@dataclass(slots=True)
class Drive:
    """A car and a controller on one bus; the files of each process are in its own folder."""

    bus: str
    channel: str
    folder: Path
    running: ExitStack
    server: subprocess.Popen[bytes] | None = None

    def start_car(self, duration_s: float = 60.0) -> subprocess.Popen[bytes]:
        """Straight on and slowly, so that a stop takes two seconds."""
        scenario = self.folder / "straight.toml"
        scenario.write_text(
            f'format = 2\nname = "straight"\nduration_s = {duration_s}\n'
            "[reference]\nspeed_kmh = 30.0\n"
        )
        return self.start_program("car", "sim_bridge.cli", "--scenario", str(scenario))

    def start_controller(self, name: str = "controller") -> subprocess.Popen[bytes]:
        # Deadlines are not tested here: a shared machine may stall longer than a vehicle's.
        options = ("--realtime.deadline-ms", "25", "--wait-s", "60", "--model-trial", "off")
        model = str(shipped_model("lti"))
        return self.start_program(name, "rt_controller.cli", "--model", model, *options)

    def start_program(self, name: str, module: str, *options: str) -> subprocess.Popen[bytes]:
        (self.folder / name).mkdir()
        bus = ("--bus", self.bus, "--channel", self.channel)
        summary = ("--json", str(self.folder / name / "summary.json"))
        command = program(module, *bus, *summary, *options)
        return start(*command, log=self.folder / f"{name}.log", running=self.running)

    def log(self, name: str) -> str:
        return (self.folder / f"{name}.log").read_text(errors="replace")

    def summary(self, name: str) -> dict[str, Any]:
        found: dict[str, Any] = json.loads((self.folder / name / "summary.json").read_text())
        return found

    def wait_for_nominal(self) -> None:
        wait_until(lambda: "NOMINAL" in self.log("controller"), "a driving controller")

    def wait_for_driven(self) -> None:
        """Until half a second after the first command: by then the car has received it."""
        wait_until(lambda: self.log("controller").count("NOMINAL") > 1, "a driven car")

    def expect_exit(self, process: subprocess.Popen[bytes], name: str, *codes: int) -> None:
        assert process.wait(PATIENCE_S) in codes, self.log(name)


def wait_until(condition: Callable[[], bool], what: str) -> None:
    give_up = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < give_up, f"expected {what} within {PATIENCE_S:g} s"
        time.sleep(0.02)


@pytest.fixture
def local(tmp_path: Path) -> Iterator[Drive]:
    """On the bus in shared memory."""
    with ExitStack() as running:
        yield Drive("local", f"test-{uuid.uuid4().hex}", tmp_path, running)


@pytest.fixture
def remote(tmp_path: Path) -> Iterator[Drive]:
    """On python-can's virtual bus behind a local server."""
    pytest.importorskip("can_remote", reason="the extra [remote] is not installed")
    with ExitStack() as running:
        server, channel = start_bus_server(tmp_path / "server.log", running)
        yield Drive("remote", channel, tmp_path, running, server)


@pytest.mark.parametrize("bus", ["local", pytest.param("remote", marks=pytest.mark.nightly)])
def test_two_processes_drive_a_mission_to_its_end(bus: str, request: pytest.FixtureRequest) -> None:
    drive: Drive = request.getfixturevalue(bus)
    car, controller = drive.start_car(duration_s=2.0), drive.start_controller()
    controller.wait(PATIENCE_S)
    drive.expect_exit(car, "car", 0)
    by_car, by_controller = drive.summary("car"), drive.summary("controller")
    assert not by_car["watchdog_braked"]
    assert by_controller["final_mode"] == "STANDBY"
    # Both ends measure the same drive, except for the quantisation of the frames.
    assert by_controller["ey_rms_m"] == pytest.approx(by_car["ey_rms_m"], abs=2e-3)


@pytest.mark.parametrize(
    "how", [signal.SIGKILL, pytest.param(signal.SIGSTOP, marks=pytest.mark.nightly)]
)
def test_the_car_brakes_to_a_stop_when_its_controller_is_killed_or_frozen(
    local: Drive, how: signal.Signals
) -> None:
    car, controller = local.start_car(), local.start_controller()
    local.wait_for_nominal()
    controller.send_signal(how)
    local.expect_exit(car, "car", 5)
    assert "stopped sending" in local.log("car")
    assert local.summary("car")["watchdog_braked"]
    assert local.summary("car")["final_speed_mps"] < 0.5


def test_ctrl_c_stops_the_car_and_ends_both_programs(local: Drive) -> None:
    car, controller = local.start_car(), local.start_controller()
    local.wait_for_nominal()
    controller.send_signal(signal.SIGINT)
    local.expect_exit(controller, "controller", 0, 4)
    local.expect_exit(car, "car", 0)
    assert "the controller ended its drive" in local.log("car")
    assert local.summary("controller")["ending"] == "STOPPED"
    assert local.summary("car")["final_speed_mps"] < 0.5


@pytest.mark.nightly
def test_ctrl_c_at_the_car_ends_the_mission_and_both_programs(local: Drive) -> None:
    car, controller = local.start_car(), local.start_controller()
    local.wait_for_driven()
    car.send_signal(signal.SIGINT)
    local.expect_exit(car, "car", 0)
    local.expect_exit(controller, "controller", 0, 4)
    assert local.summary("controller")["ending"] == "MISSION_OVER"
    assert not local.summary("car")["watchdog_braked"]


@pytest.mark.nightly
def test_a_controller_whose_car_is_killed_ends_in_a_safe_stop(local: Drive) -> None:
    car, controller = local.start_car(), local.start_controller()
    local.wait_for_nominal()
    car.kill()
    local.expect_exit(controller, "controller", 6)
    summary = local.summary("controller")
    assert summary["final_mode"] == "SAFE_STOP"
    assert summary["stop_cause"] in {"STATE_LOST", "MISSION_LOST"}


@pytest.mark.nightly
@pytest.mark.parametrize("signals", [0, 1])
def test_a_server_that_freezes_holds_up_neither_end(remote: Drive, signals: int) -> None:
    car, controller = remote.start_car(), remote.start_controller()
    remote.wait_for_nominal()
    assert remote.server is not None
    remote.server.send_signal(signal.SIGSTOP)
    for process in (car, controller) if signals else ():
        process.send_signal(signal.SIGTERM)
    remote.expect_exit(car, "car", 0, 5)
    remote.expect_exit(controller, "controller", 0, 5, 6)
    remote.server.send_signal(signal.SIGCONT)


@pytest.mark.nightly
def test_a_bus_that_fails_ends_both_programs_with_a_message(remote: Drive) -> None:
    car, controller = remote.start_car(), remote.start_controller()
    remote.wait_for_nominal()
    assert remote.server is not None
    remote.server.kill()
    remote.expect_exit(car, "car", 5)
    remote.expect_exit(controller, "controller", 5)
    for name in ("car", "controller"):
        assert "cannot be read" in remote.log(name)
        assert "Traceback" not in remote.log(name)


@pytest.mark.nightly
def test_a_second_vehicle_is_refused_and_does_not_disturb_the_first(local: Drive) -> None:
    car, controller = local.start_car(), local.start_controller()
    local.wait_for_nominal()
    second = local.start_program("second", "sim_bridge.cli")
    local.expect_exit(second, "second", 5)
    assert "another one" in local.log("second")
    controller.send_signal(signal.SIGINT)
    local.expect_exit(controller, "controller", 0, 4)
    local.expect_exit(car, "car", 0)


@pytest.mark.nightly
def test_a_second_controller_is_refused_and_does_not_disturb_the_first(local: Drive) -> None:
    local.start_car()
    controller = local.start_controller()
    local.wait_for_nominal()
    second = local.start_controller("second")
    local.expect_exit(second, "second", 5)
    assert "another one" in local.log("second")
    controller.send_signal(signal.SIGINT)
    controller.wait(PATIENCE_S)
    assert local.summary("controller")["stop_cause"] != "SECOND_CONTROLLER"
