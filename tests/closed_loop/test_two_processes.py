"""Controller and car in two processes, in real time; what a person or a full disk does to them."""

import json
import signal
import subprocess
import time
import uuid
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import can
import pytest
from own_car import EXAMPLE, command_reader
from processes import program, start_bus_server
from virtual_drive import SHORT_LANE_CHANGE

from benchmarks.cadence import start
from rt_controller.mapping.car_file import read_car
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

    def start_car(self, duration_s=60.0):
        """Straight on and slowly, so that a stop takes two seconds."""
        scenario = self.folder / "straight.toml"
        scenario.write_text(
            f'format = 2\nname = "straight"\nduration_s = {duration_s}\n'
            "[reference]\nspeed_kmh = 40.0\n"
        )
        return self.start_program("car", "sim_bridge.cli", "--scenario", str(scenario))

    def start_controller(self, name="controller"):
        # Deadlines are not tested here: a shared machine may stall longer than a vehicle's.
        options = ("--realtime.deadline-ms", "25", "--wait-s", "60")
        model = str(shipped_model("lti"))
        return self.start_program(name, "rt_controller.cli", "--model", model, *options)

    def start_program(self, name, module, *options):
        (self.folder / name).mkdir()
        bus = ("--bus", self.bus, "--channel", self.channel)
        summary = ("--json", str(self.folder / name / "summary.json"))
        command = program(module, *bus, *summary, *options)
        return start(*command, log=self.folder / f"{name}.log", running=self.running)

    def log(self, name):
        return (self.folder / f"{name}.log").read_text(errors="replace")

    def summary(self, name):
        return json.loads((self.folder / name / "summary.json").read_text())

    def wait_for_nominal(self):
        wait_until(lambda: "NOMINAL" in self.log("controller"), "a driving controller")

    def wait_for_driven(self):
        """Until half a second after the first command: by then the car has received it."""
        wait_until(lambda: self.log("controller").count("NOMINAL") > 1, "a driven car")

    def expect_exit(self, process, name, *codes):
        assert process.wait(PATIENCE_S) in codes, self.log(name)


def wait_until(condition, what):
    give_up = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < give_up, f"expected {what} within {PATIENCE_S:g} s"
        time.sleep(0.02)


@pytest.fixture
def local(tmp_path):
    """On the bus in shared memory."""
    with ExitStack() as running:
        yield Drive("local", f"test-{uuid.uuid4().hex}", tmp_path, running)


@pytest.fixture
def remote(tmp_path):
    """On python-can's virtual bus behind a local server."""
    pytest.importorskip("can_remote", reason="the extra [remote] is not installed")
    with ExitStack() as running:
        server, channel = start_bus_server(tmp_path / "server.log", running)
        yield Drive("remote", channel, tmp_path, running, server)


@pytest.mark.parametrize("bus", ["local", pytest.param("remote", marks=pytest.mark.nightly)])
def test_two_processes_drive_a_mission_to_its_end(bus, request):
    drive = request.getfixturevalue(bus)
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
def test_the_car_brakes_to_a_stop_when_its_controller_is_killed_or_frozen(local, how):
    car, controller = local.start_car(), local.start_controller()
    local.wait_for_nominal()
    controller.send_signal(how)
    local.expect_exit(car, "car", 5)
    assert "stopped sending" in local.log("car")
    assert local.summary("car")["watchdog_braked"]
    assert local.summary("car")["final_speed_mps"] < 0.5


def test_ctrl_c_stops_the_car_and_ends_both_programs(local):
    car, controller = local.start_car(), local.start_controller()
    local.wait_for_nominal()
    controller.send_signal(signal.SIGINT)
    local.expect_exit(controller, "controller", 0, 4)
    local.expect_exit(car, "car", 0)
    assert "the controller ended its drive" in local.log("car")
    assert local.summary("controller")["ending"] == "STOPPED"
    assert local.summary("car")["final_speed_mps"] < 0.5


@pytest.mark.nightly
def test_ctrl_c_at_the_car_ends_the_mission_and_both_programs(local):
    car, controller = local.start_car(), local.start_controller()
    local.wait_for_driven()
    car.send_signal(signal.SIGINT)
    local.expect_exit(car, "car", 0)
    local.expect_exit(controller, "controller", 0, 4)
    assert local.summary("controller")["ending"] == "MISSION_OVER"
    assert not local.summary("car")["watchdog_braked"]


@pytest.mark.nightly
def test_a_controller_whose_car_is_killed_ends_in_a_safe_stop(local):
    car, controller = local.start_car(), local.start_controller()
    local.wait_for_nominal()
    car.kill()
    local.expect_exit(controller, "controller", 6)
    summary = local.summary("controller")
    assert summary["final_mode"] == "SAFE_STOP"
    assert summary["stop_cause"] in {"STATE_LOST", "MISSION_LOST"}


@pytest.mark.nightly
@pytest.mark.parametrize("signals", [0, 1])
def test_a_server_that_freezes_holds_up_neither_end(remote, signals):
    car, controller = remote.start_car(), remote.start_controller()
    remote.wait_for_nominal()
    remote.server.send_signal(signal.SIGSTOP)
    for process in (car, controller) if signals else ():
        process.send_signal(signal.SIGTERM)
    remote.expect_exit(car, "car", 0, 5)
    remote.expect_exit(controller, "controller", 0, 5, 6)
    remote.server.send_signal(signal.SIGCONT)


@pytest.mark.nightly
def test_a_bus_that_fails_ends_both_programs_with_a_message(remote):
    car, controller = remote.start_car(), remote.start_controller()
    remote.wait_for_nominal()
    remote.server.kill()
    remote.expect_exit(car, "car", 5)
    remote.expect_exit(controller, "controller", 5)
    for name in ("car", "controller"):
        assert "cannot be read" in remote.log(name)
        assert "Traceback" not in remote.log(name)


@pytest.mark.nightly
@pytest.mark.parametrize("second", ["vehicle", "controller"])
def test_a_second_vehicle_or_controller_is_refused_and_does_not_disturb_the_first(local, second):
    car, controller = local.start_car(), local.start_controller()
    local.wait_for_nominal()
    if second == "vehicle":
        refused = local.start_program("second", "sim_bridge.cli")
    else:
        refused = local.start_controller("second")
    local.expect_exit(refused, "second", 5)
    assert "another one" in local.log("second")
    controller.send_signal(signal.SIGINT)
    local.expect_exit(controller, "controller", 0, 4)
    local.expect_exit(car, "car", 0)
    assert local.summary("controller")["stop_cause"] != "SECOND_CONTROLLER"


DRIVE = ("--bus", "virtual", "--pace", "lockstep", "--scenario", "straight", "--model", "lti")


@pytest.mark.nightly
def test_a_drive_goes_on_without_its_output(tmp_path):
    figures = tmp_path / "figures.json"
    command = program("rt_controller.cli", *DRIVE, "--json", str(figures))
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as running:
        running.stdout.readline()
        running.stdout.close()
        assert running.wait() == 0
    assert json.loads(figures.read_text())["ending"] == "MISSION_OVER"


@pytest.mark.nightly
def test_a_log_on_a_full_disk_is_said_at_once_and_at_the_end(tmp_path):
    """No file may become longer than 20 kB: EFBIG in place of ENOSPC."""
    figures = tmp_path / "figures.json"
    command = program("rt_controller.cli", *DRIVE, "--quiet", "--record", str(tmp_path / "d.log"))
    done = subprocess.run(
        ["prlimit", "--fsize=20000", *command, "--json", str(figures)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 9
    assert "expected room for the log" in done.stderr
    found = json.loads(figures.read_text())
    assert 0 < found["log_frames_written"] < 1000 < found["log_frames_dropped"]
    assert "too large" in found["log_failure"]


CAR = """
[car]
wheelbase_m = 2.91
rear_axle_m = 1.8604
steering_ratio = 18.5
rear_slip_s2_per_m = 0.00516
yaw_inertia_m = 0.45
"""
GATEWAY_PATIENCE_S, WAIT_S = 240.0, "200"


@pytest.fixture
def mapping(tmp_path):
    """The example with the constants of the car, so that a linear model drives it too."""
    folder = tmp_path / "mapping"
    folder.mkdir()
    for name in ("car.dbc", "line.csv"):
        (folder / name).write_text((EXAMPLE.parent / name).read_text())
    (folder / "car.toml").write_text(EXAMPLE.read_text() + CAR)
    return str(folder / "car.toml")


@pytest.mark.nightly
@pytest.mark.parametrize("period_s", [0.025, 0.05])
def test_a_gateway_joins_the_car_and_an_unchanged_controller(tmp_path, mapping, period_s):
    """The car receives the release last, also if its message has twice the control period."""
    table = "[messages.DriveRequest]"
    text = Path(mapping).read_text().replace(table, f"{table}\nperiod_s = {period_s}")
    Path(mapping).write_text(text)
    reader, received = command_reader(read_car(Path(mapping))), {}
    car_bus, bus = (f"test-{uuid.uuid4().hex}" for _ in range(2))
    model = str(shipped_model("lti"))
    with ExitStack() as running:
        watched = running.enter_context(can.Bus(interface="local", channel=car_bus))
        listener = can.Notifier(watched, [lambda frame: received.update(reader.read(frame) or {})])
        running.callback(listener.stop)

        def run(name, *options):
            return start(*program(*options), log=tmp_path / f"{name}.log", running=running)

        car = run(
            "car", "sim_bridge.cli", "--bus", "local", "--channel", car_bus,
            "--signals", mapping, "--scenario", SHORT_LANE_CHANGE, "--wait-s", WAIT_S,
        )  # fmt: skip
        gateway = run(
            "gateway", "rt_controller.cli", "signals", "gateway", mapping, "--bus", "local",
            "--channel", bus, "--car-bus", "local", "--car-channel", car_bus, "--model", model,
        )  # fmt: skip
        controller = run(
            "controller", "rt_controller.cli", "--bus", "local", "--channel", bus,
            "--model", model, "--realtime.deadline-ms", "25", "--wait-s", WAIT_S,
        )  # fmt: skip
        assert car.wait(GATEWAY_PATIENCE_S) == 0, (tmp_path / "car.log").read_text()
        assert controller.wait(GATEWAY_PATIENCE_S) in (0, 4), (
            tmp_path / "controller.log"
        ).read_text()
        give_up = time.monotonic() + GATEWAY_PATIENCE_S
        while abs(received["commands.steer_rad"]) > 1e-3 and time.monotonic() < give_up:
            time.sleep(0.025)  # the gateway returns the wheel to the centre
        gateway.send_signal(signal.SIGINT)
        assert gateway.wait(GATEWAY_PATIENCE_S) == 0, (tmp_path / "gateway.log").read_text()
    found = (tmp_path / "gateway.log").read_text()
    assert "brakings 0" in found
    assert "limited 0  refused 0" in found
    assert received["driving"] == 0.0
    assert received["commands.brake_n"] == received["commands.throttle"] == 0.0
    assert received["commands.steer_rad"] == pytest.approx(0.0, abs=1e-3)
