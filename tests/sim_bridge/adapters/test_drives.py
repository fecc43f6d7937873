"""Whole drives over the bus with FMUs and CommonRoad's car behind the bridge."""

import json
from math import isnan
from pathlib import Path

import pytest

pytest.importorskip("fmpy", reason="the extra [fmu] is not installed")
pytest.importorskip("pythonfmu", reason="the extra [test] is not installed")

from made_fmus import FOREIGN_MAPPING, make_foreign_car
from recorded_frames import RecordedFrames
from bridge_rig import send_command
from virtual_drive import SHORT_LANE_CHANGE

from rt_controller import cli
from rt_controller.bus.messages import MISSION, STATE, Command, Node
from rt_controller.bus.receive import Inbox
from rt_controller.bus.send import Outbox
from rt_controller.bus.transport import open_bus
from rt_controller.contract.errors import ConfigError, PlantError
from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.contract.timing import PERIOD_NS
from rt_controller.settings import CarSettings
from sim_bridge.adapters.plants import open_plant
from sim_bridge.bridge import END_TICKS, Bridge, Delay
from sim_bridge.fmu_export.archive import build_fmu
from sim_bridge.scenario import load_scenario
from sim_bridge.session import build_car

CRUISE = ControlInput(0.1, 0.0, 0.0)


@pytest.mark.parametrize(
    ("option", "value"),
    [("--plant", "commonroad:2"), ("--plant-mapping", "x.toml"), ("--friction", "0.5")],
)
def test_options_of_the_plant_are_refused_on_a_real_bus(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], option: str, value: str
) -> None:
    arguments = ("--bus", "socketcan", "--channel", "can0", option, value)
    monkeypatch.setattr("sys.argv", ["rt-controller", *arguments])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    assert f"{option}: expected --bus virtual" in " ".join(capsys.readouterr().err.split())


def drive(folder: Path, monkeypatch: pytest.MonkeyPatch, *options: str) -> tuple[int, dict]:
    """Exit code and figures of a run of the controller in lockstep with its own car."""
    figures = folder / "summary.json"
    base = ("--bus", "virtual", "--pace", "lockstep", "--quiet", "--channel", folder.name)
    # The time that a tick takes on this machine is not tested here.
    common = ("--max-misses", "1000000", "--json", str(figures))
    monkeypatch.setattr("sys.argv", ["rt-controller", *base, *common, *options])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return ended.value.code or 0, json.loads(figures.read_text())


def test_the_exported_car_and_the_own_car_drive_the_same_lane_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    build_fmu(tmp_path / "car.fmu")
    runs = [
        drive(tmp_path, monkeypatch, "--scenario", SHORT_LANE_CHANGE, "--plant", plant)
        for plant in ("own", f"fmu:{tmp_path / 'car.fmu'}")
    ]
    assert [code for code, _ in runs] == [0, 0]
    for figure in ("ey_rms_m", "ey_peak_m", "epsi_rms_rad", "vx_rms_mps", "ticks"):
        assert runs[0][1][figure] == runs[1][1][figure]


def test_commonroads_car_is_driven_through_the_lane_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The controller's model was not learned from this car."""
    pytest.importorskip("vehiclemodels", reason="the extra [commonroad] is not installed")
    code, figures = drive(tmp_path, monkeypatch, "--plant", "commonroad:2")
    assert code == 0
    assert figures["final_mode"] == "STANDBY"
    assert figures["ey_peak_m"] <= 0.5


def test_an_fmu_that_fails_in_mid_drive_ends_in_a_safe_stop_and_a_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    fmu = make_foreign_car(
        tmp_path, "Failing", FOREIGN_MAPPING.replace("trailers = 1", "fails_at_s = 1.0")
    )
    code, figures = drive(tmp_path, monkeypatch, "--plant", f"fmu:{fmu}")
    assert code == PlantError.exit_code == 7
    assert figures["final_mode"] == "SAFE_STOP"
    received = " ".join(capsys.readouterr().err.split())
    assert "the car's plant failed" in received
    assert "no fuel left" in received


@pytest.mark.parametrize("parameter", ["fails_at_s", "loses_itself_at_s"])
def test_a_failed_plant_is_sent_as_an_invalid_state_until_the_bridge_ends(
    tmp_path: Path, parameter: str
) -> None:
    fmu = make_foreign_car(
        tmp_path, "Broken", FOREIGN_MAPPING.replace("trailers = 1", f"{parameter} = 0.2")
    )
    scenario = load_scenario("straight")
    car = build_car(scenario, CarSettings(plant=f"fmu:{fmu}"))
    channel = tmp_path.name
    recorder = RecordedFrames()
    with open_bus("virtual", channel) as bus, open_bus("virtual", channel) as far_end:
        bridge = Bridge(bus, car, scenario, recorder, delay=Delay(0, 0))
        controller = Outbox(far_end, Node.CONTROLLER)
        received = Inbox(Node.CONTROLLER)
        now_ns, ticks = 0, 0
        while not bridge.is_over:
            now_ns += PERIOD_NS
            ticks += 1
            # The first command is not used yet.
            send_command(controller, Command(CRUISE, Mode.NOMINAL), now_ns, ticks - 2)
            bridge.tick(now_ns)
            received.drain(far_end, now_ns)
    assert ticks == 1 + 8 + 1 + END_TICKS
    for codec in STATE.codecs[:2]:
        assert [frame[1] >> 4 & 1 for frame in recorder.of(codec)] == [1] * 9 + [0] * (ticks - 9)
    for frame in recorder.of(STATE.codecs[1])[9:]:
        assert any(isnan(value) for value in STATE.codecs[1].decode(frame))
    # The controller keeps the last valid state, whose age grows.
    state, mission = received.newest(STATE), received.newest(MISSION)
    assert state is not None
    assert state.arrival_ns == 9 * PERIOD_NS
    assert mission is not None
    assert mission.content.is_engaged
    summary = bridge.summary()
    assert summary.ticks == 8
    assert summary.plant_failure is not None
    assert summary.final_speed_mps == pytest.approx(state.content.state.vx_mps, abs=0.01)
    bridge.close()


def test_a_plant_is_refused_before_the_drive_if_it_has_no_friction_or_no_first_period(
    tmp_path: Path,
) -> None:
    mapping = FOREIGN_MAPPING.replace('road_friction = "mu"\n', "")
    fmu = make_foreign_car(tmp_path, "Refused", mapping)
    with pytest.raises(ConfigError, match="`friction`: expected an FMU whose mapping"):
        open_plant(CarSettings(plant=f"fmu:{fmu}", friction=0.4), 0.85)
    fmu.with_suffix(".toml").write_text(mapping.replace("trailers = 1", "fails_at_s = 0.0"))
    with pytest.raises(ConfigError, match="drives a first control period"):
        build_car(load_scenario("straight"), CarSettings(plant=f"fmu:{fmu}"))
