"""Whole drives over the bus with other people's plants behind the bridge."""

import json
import subprocess
import sys
import threading
from math import isnan
from pathlib import Path

import can
import pytest

pytest.importorskip("fmpy", reason="the extra [fmu] is not installed")
pytest.importorskip("pythonfmu", reason="the extra [fmu] is not installed")

from made_fmus import FOREIGN_MAPPING, make_foreign_car

from rt_controller import cli
from rt_controller.bus import frames
from rt_controller.bus.codec import MessageCodec, nibble_of
from rt_controller.bus.inbox import CommandInbox, Inbox
from rt_controller.bus.outbox import ControllerOutbox, VehicleOutbox
from rt_controller.bus.transport import open_bus
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.contract.timing import PERIOD_NS
from sim_bridge import cli as bridge_cli
from sim_bridge.adapters.export import build_fmu
from sim_bridge.adapters.plants import PlantChoice, open_plant
from sim_bridge.bridge import FAREWELL_TICKS, Bridge
from sim_bridge.scenario import load_scenario
from sim_bridge.session import build_car

CRUISE = ControlInput(0.1, 0.0, 0.0)


@pytest.mark.parametrize(
    ("option", "value"),
    [("--plant", "commonroad:2"), ("--plant-mapping", "x.toml"), ("--friction", "0.5")],
)
def test_a_plant_is_chosen_where_the_car_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], option: str, value: str
) -> None:
    arguments = ("--bus", "socketcan", "--channel", "can0", option, value)
    monkeypatch.setattr("sys.argv", ["rt-controller", *arguments])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    assert "with --bus virtual only" in " ".join(capsys.readouterr().err.split())


class Tap:
    """Keeps all frames that pass."""

    def __init__(self) -> None:
        self._frames: list[tuple[int, bytes]] = []

    def record(self, message: can.Message, timestamp_ns: int) -> None:
        self._frames.append((message.arbitration_id, bytes(message.data)))

    def of(self, codec: MessageCodec) -> list[bytes]:
        """The frames of one message, in order."""
        return [data for number, data in self._frames if number == codec.arbitration_id]


def drive(folder: Path, monkeypatch: pytest.MonkeyPatch, *options: str) -> tuple[int, dict]:
    """Exit code and figures of a run of the controller with its own car."""
    figures = folder / "summary.json"
    base = ("--bus", "virtual", "--quiet", "--channel", folder.name, "--json", str(figures))
    monkeypatch.setattr("sys.argv", ["rt-controller", *base, *options])
    # A shared machine may stall longer than a vehicle's: lateness is not what is tested here.
    monkeypatch.setattr(cli, "EXIT_DEADLINE", 0)
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return ended.value.code or 0, json.loads(figures.read_text())


def test_the_exported_car_and_the_own_car_drive_the_same_lane_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    build_fmu(tmp_path / "car.fmu")
    runs = [
        drive(tmp_path, monkeypatch, "--pace", "lockstep", "--plant", plant)
        for plant in ("own", f"fmu:{tmp_path / 'car.fmu'}")
    ]
    assert [code for code, _ in runs] == [0, 0]
    for figure in ("ey_rms_m", "ey_peak_m", "epsi_rms_rad", "vx_rms_mps", "ticks"):
        assert runs[0][1][figure] == runs[1][1][figure]


def test_commonroads_car_is_driven_through_the_lane_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The controller's model has never seen this car."""
    pytest.importorskip("vehiclemodels", reason="the extra [commonroad] is not installed")
    options = ("--pace", "lockstep", "--plant", "commonroad:2")
    code, figures = drive(tmp_path, monkeypatch, *options)
    assert code == 0
    assert figures["final_mode"] == "STANDBY"
    assert figures["ey_peak_m"] <= 0.5


def test_an_fmu_drives_by_the_wall_clock(tmp_path: Path) -> None:
    fmu, figures = make_foreign_car(tmp_path, "WallClock"), tmp_path / "summary.json"
    # In a process of its own: threads and memory of other tests would be in its way.
    program = (sys.executable, "-c", "from rt_controller.cli import main; main()")
    options = ("--bus", "virtual", "--quiet", "--channel", tmp_path.name, "--json", str(figures))
    drive = ("--duration-s", "1", "--plant", f"fmu:{fmu}")
    # A shared machine that stalls for some periods has the car stopped safely; it is tried again.
    for _ in range(3):
        command = [*program, *options, *drive]
        ended = subprocess.run(command, check=False, capture_output=True, timeout=120.0)
        if ended.returncode != cli.EXIT_SAFE_STOP:
            break
    # Lateness is not what is tested here.
    assert ended.returncode in (0, cli.EXIT_DEADLINE), ended.stderr.decode()
    assert json.loads(figures.read_text())["ticks"] > 20


def test_an_fmu_that_fails_in_mid_drive_ends_in_a_safe_stop_and_a_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    fmu = make_foreign_car(
        tmp_path, "Failing", FOREIGN_MAPPING.replace("trailers = 1", "fails_at_s = 1.0")
    )
    options = ("--pace", "lockstep", "--plant", f"fmu:{fmu}")
    code, figures = drive(tmp_path, monkeypatch, *options)
    assert code == cli.EXIT_SAFE_STOP
    assert figures["final_mode"] == "SAFE_STOP"
    heard = " ".join(capsys.readouterr().err.split())
    assert "the car's plant failed" in heard
    assert "the fuel ran out" in heard


@pytest.mark.parametrize("parameter", ["fails_at_s", "loses_itself_at_s"])
def test_a_failed_plant_is_told_as_an_invalid_state_until_the_bridge_leaves(
    tmp_path: Path, parameter: str
) -> None:
    fmu = make_foreign_car(
        tmp_path, "Broken", FOREIGN_MAPPING.replace("trailers = 1", f"{parameter} = 0.2")
    )
    scenario = load_scenario("straight")
    car = build_car(scenario, PlantChoice(plant=f"fmu:{fmu}"))
    channel = tmp_path.name
    tap = Tap()
    with open_bus("virtual", channel) as bus, open_bus("virtual", channel) as far_end:
        bridge = Bridge(
            bus=bus,
            inbox=CommandInbox(),
            outbox=VehicleOutbox(bus, tap),
            car=car,
            scenario=scenario,
        )
        controller, heard = ControllerOutbox(far_end), Inbox()
        now_ns, ticks = 0, 0
        while not bridge.is_over:
            now_ns += PERIOD_NS
            ticks += 1
            controller.send_command(CRUISE, Mode.NOMINAL, ticks - 2, now_ns)
            bridge.tick(now_ns)
            heard.drain(far_end, now_ns)
    assert ticks == 8 + 1 + FAREWELL_TICKS
    for frames_of_a_state in (tap.of(frames.STATE_A), tap.of(frames.STATE_B)):
        assert [nibble_of(frame) for frame in frames_of_a_state] == [1] * 8 + [0] * (ticks - 8)
    for frame in tap.of(frames.STATE_B)[8:]:
        assert any(isnan(value) for value in frames.STATE_B.decode(frame))
    # The controller keeps what it heard last, and sees it grow old.
    assert heard.state is not None
    assert heard.state.arrival_ns == 8 * PERIOD_NS
    assert heard.mission is not None
    assert heard.mission.is_engaged
    summary = bridge.summary()
    assert summary.ticks == 8
    assert summary.plant_failure is not None
    assert summary.final_speed_mps == pytest.approx(heard.state.state.vx_mps, abs=0.01)
    bridge.close()


def test_sim_bridge_says_that_its_plant_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    fmu = make_foreign_car(
        tmp_path, "Tired", FOREIGN_MAPPING.replace("trailers = 1", "fails_at_s = 0.2")
    )
    figures = tmp_path / "car.json"
    base = ("--bus", "virtual", "--quiet", "--channel", tmp_path.name, "--json", str(figures))
    monkeypatch.setattr("sys.argv", ["sim-bridge", *base, "--plant", f"fmu:{fmu}"])
    over = threading.Event()
    controller = threading.Thread(target=command, args=(tmp_path.name, over))
    controller.start()
    try:
        with pytest.raises(SystemExit) as ended:
            bridge_cli.main()
    finally:
        over.set()
        controller.join()
    assert ended.value.code == 7
    assert "the fuel ran out" in " ".join(capsys.readouterr().err.split())
    summary = json.loads(figures.read_text())
    assert summary["ticks"] == 8
    assert "the fuel ran out" in summary["plant_failure"]


def command(channel: str, over: threading.Event) -> None:
    """A controller that always wants the same, and answers every state it hears."""
    with open_bus("virtual", channel) as bus:
        outbox, inbox, answered = ControllerOutbox(bus), Inbox(), None
        while not over.wait(0.005):
            inbox.drain(bus, 0)
            if inbox.state is not None and inbox.state is not answered:
                answered = inbox.state
                outbox.send_command(CRUISE, Mode.NOMINAL, answered.counter, 0)


def test_a_friction_that_the_fmu_would_not_hear_of_is_refused(tmp_path: Path) -> None:
    fmu = make_foreign_car(tmp_path, "Deaf", FOREIGN_MAPPING.replace('road_friction = "mu"\n', ""))
    with pytest.raises(ConfigError, match="--friction: expected an FMU whose mapping"):
        open_plant(PlantChoice(plant=f"fmu:{fmu}", friction=0.4), 0.85)


def test_a_plant_that_fails_at_once_is_refused_before_the_drive(tmp_path: Path) -> None:
    fmu = make_foreign_car(
        tmp_path, "Stillborn", FOREIGN_MAPPING.replace("trailers = 1", "fails_at_s = 0.0")
    )
    with pytest.raises(ConfigError, match="drives a first period"):
        build_car(load_scenario("straight"), PlantChoice(plant=f"fmu:{fmu}"))
