"""Controller and car in processes of their own, on a bus between them (127.0.0.1)."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

pytest.importorskip("can_remote", reason="the extra [remote] is not installed")

PATIENCE_S = 90.0


@dataclass(frozen=True, slots=True)
class Road:
    """A CAN bus between processes: python-can's virtual bus behind a local server."""

    channel: str
    server: subprocess.Popen


@pytest.fixture
def road() -> Iterator[Road]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    server = subprocess.Popen(
        [
            *(sys.executable, "-m", "can_remote", "-H", "127.0.0.1", "-p", str(port)),
            *("-i", "virtual", "-c", f"test-{port}", "-b", "500000"),
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        wait_until(lambda: is_listening(port), "the server of the bus")
        yield Road(f"ws://127.0.0.1:{port}/", server)
    finally:
        server.kill()
        server.wait()


@pytest.fixture
def channel(road: Road) -> str:
    return road.channel


def is_listening(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def wait_until(condition: Callable[[], bool], what: str) -> None:
    give_up = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < give_up, f"waited in vain for {what}"
        time.sleep(0.05)


def start(log: Path, module: str, *arguments: str) -> subprocess.Popen:
    program = f"import sys; from {module} import main; sys.argv[0] = '{module}'; main()"
    with log.open("wb") as output:
        return subprocess.Popen(
            [sys.executable, "-c", program, *arguments],
            stdout=output,
            stderr=output,
            env={**os.environ, "COLUMNS": "200"},
        )


def start_car(channel: str, folder: Path, duration_s: float = 60.0) -> subprocess.Popen:
    """Straight on, for so long that whatever shall happen meanwhile does on a slow machine too."""
    scenario = folder / "straight.toml"
    scenario.write_text(
        f'name = "straight"\nspeed_kmh = 80.0\ncurvature_per_m = 0.0\nduration_s = {duration_s}\n'
        f"road_friction = 0.85\nmoves = []\n"
    )
    return start(
        folder / "car.log",
        "sim_bridge.cli",
        *("--bus", "remote", "--channel", channel, "--scenario", str(scenario)),
        *("--json", str(folder / "car.json")),
    )


def start_controller(channel: str, folder: Path) -> subprocess.Popen:
    return start(
        folder / "controller.log",
        "rt_controller.cli",
        *("--bus", "remote", "--channel", channel, "--json", str(folder / "controller.json")),
        # A shared machine may stall longer than a vehicle's: lateness is not what is tested here.
        *("--realtime.deadline-ms", "25", "--wait-s", "60"),
    )


def says(log: Path, words: str) -> bool:
    return log.exists() and words in log.read_text(errors="replace")


def test_two_processes_drive_a_mission_to_its_end(channel: str, tmp_path: Path) -> None:
    car, controller = (
        start_car(channel, tmp_path, duration_s=5.0),
        start_controller(channel, tmp_path),
    )
    try:
        controller.wait(PATIENCE_S)
        assert car.wait(PATIENCE_S) == 0, (tmp_path / "car.log").read_text()
    finally:
        car.kill()
        controller.kill()
    seen_by_car = json.loads((tmp_path / "car.json").read_text())
    seen_by_controller = json.loads((tmp_path / "controller.json").read_text())
    assert not seen_by_car["watchdog_braked"]
    assert seen_by_controller["final_mode"] == "STANDBY"
    # Both ends tell the same story, but for the quantisation of the frames.
    assert seen_by_controller["ey_rms_m"] == pytest.approx(seen_by_car["ey_rms_m"], abs=2e-3)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_a_controller_that_dies_or_freezes_leaves_a_braked_car(
    channel: str, tmp_path: Path, how: signal.Signals
) -> None:
    car, controller = start_car(channel, tmp_path), start_controller(channel, tmp_path)
    try:
        wait_until(lambda: says(tmp_path / "controller.log", "NOMINAL"), "a driving controller")
        controller.send_signal(how)
        assert car.wait(PATIENCE_S) == 5, (tmp_path / "car.log").read_text()
    finally:
        car.kill()
        controller.kill()
    summary = json.loads((tmp_path / "car.json").read_text())
    assert summary["watchdog_braked"]
    assert summary["final_speed_mps"] < 0.5
    assert "fell silent" in (tmp_path / "car.log").read_text()


def test_a_car_that_dies_leaves_a_controller_in_a_safe_stop(channel: str, tmp_path: Path) -> None:
    car, controller = start_car(channel, tmp_path), start_controller(channel, tmp_path)
    try:
        wait_until(lambda: says(tmp_path / "controller.log", "NOMINAL"), "a driving controller")
        car.kill()
        assert controller.wait(PATIENCE_S) == 6, (tmp_path / "controller.log").read_text()
    finally:
        car.kill()
        controller.kill()
    summary = json.loads((tmp_path / "controller.json").read_text())
    assert summary["final_mode"] == "SAFE_STOP"
    assert summary["stop_cause"] in {"STATE_LOST", "MISSION_LOST"}


def test_ctrl_c_ends_a_drive_in_good_order(channel: str, tmp_path: Path) -> None:
    car, controller = start_car(channel, tmp_path), start_controller(channel, tmp_path)
    try:
        wait_until(lambda: says(tmp_path / "controller.log", "NOMINAL"), "a driving controller")
        controller.send_signal(signal.SIGINT)
        assert controller.wait(PATIENCE_S) in {0, 4}
        assert car.wait(PATIENCE_S) == 5
    finally:
        car.kill()
        controller.kill()
    summary = json.loads((tmp_path / "controller.json").read_text())
    assert summary["ending"] == "STOPPED"
    assert json.loads((tmp_path / "car.json").read_text())["final_speed_mps"] < 0.5


def test_a_bus_that_dies_ends_both_with_a_word_and_no_traceback(road: Road, tmp_path: Path) -> None:
    car, controller = start_car(road.channel, tmp_path), start_controller(road.channel, tmp_path)
    try:
        wait_until(lambda: says(tmp_path / "controller.log", "NOMINAL"), "a driving controller")
        road.server.kill()
        assert car.wait(PATIENCE_S) == 5
        assert controller.wait(PATIENCE_S) == 5
    finally:
        car.kill()
        controller.kill()
    for name in ("car.log", "controller.log"):
        assert "cannot be read" in (tmp_path / name).read_text()
        assert "Traceback" not in (tmp_path / name).read_text()


def test_a_second_controller_is_turned_away_and_the_first_drives_on(
    channel: str, tmp_path: Path
) -> None:
    (tmp_path / "second").mkdir()
    car, controller = (
        start_car(channel, tmp_path, duration_s=25.0),
        start_controller(channel, tmp_path),
    )
    try:
        wait_until(lambda: says(tmp_path / "controller.log", "NOMINAL"), "a driving controller")
        second = start_controller(channel, tmp_path / "second")
        assert second.wait(PATIENCE_S) == 5
        assert car.wait(PATIENCE_S) == 0
    finally:
        for process in (car, controller, second):
            process.kill()
    assert "another one" in (tmp_path / "second" / "controller.log").read_text()
