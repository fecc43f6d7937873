"""A car with its own messages is driven as one with those of the contract."""

import signal
import time
import uuid
from contextlib import ExitStack
from pathlib import Path

import can
import pytest
from own_car import EXAMPLE, command_reader
from virtual_drive import SHORT_LANE_CHANGE

from benchmarks.processes import program, start
from rt_controller.mapping.car_file import read_car
from rt_controller.model.artifact import shipped_model

CAR = """
[car]
wheelbase_m = 2.91
rear_axle_m = 1.8604
steering_ratio = 18.5
rear_slip_s2_per_m = 0.00516
yaw_inertia_m = 0.45
"""
PATIENCE_S, WAIT_S = 240.0, "200"


@pytest.fixture
def mapping(tmp_path: Path) -> str:
    """The example with the constants of the car, so that a linear model drives it too."""
    folder = tmp_path / "mapping"
    folder.mkdir()
    for name in ("car.dbc", "line.csv"):
        (folder / name).write_text((EXAMPLE.parent / name).read_text())
    (folder / "car.toml").write_text(EXAMPLE.read_text() + CAR)
    return str(folder / "car.toml")


@pytest.mark.nightly
@pytest.mark.parametrize("period_s", [0.025, 0.05])
def test_a_gateway_joins_the_car_and_an_unchanged_controller(
    tmp_path: Path, mapping: str, period_s: float
) -> None:
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

        def run(name: str, *options: str):  # type: ignore[no-untyped-def]
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
        assert car.wait(PATIENCE_S) == 0, (tmp_path / "car.log").read_text()
        assert controller.wait(PATIENCE_S) in (0, 4), (tmp_path / "controller.log").read_text()
        give_up = time.monotonic() + PATIENCE_S
        while abs(received["commands.steer_rad"]) > 1e-3 and time.monotonic() < give_up:
            time.sleep(0.025)  # the gateway returns the wheel to the centre
        gateway.send_signal(signal.SIGINT)
        assert gateway.wait(PATIENCE_S) == 0, (tmp_path / "gateway.log").read_text()
    found = (tmp_path / "gateway.log").read_text()
    assert "brakings 0" in found
    assert "limited 0  refused 0" in found
    assert received["driving"] == 0.0
    assert received["commands.brake_n"] == received["commands.throttle"] == 0.0
    assert received["commands.steer_rad"] == pytest.approx(0.0, abs=1e-3)
