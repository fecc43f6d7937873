"""CommonRoad's car and FMUs behind the bridge: motion of the first, and whole drives."""

import json
from math import nan
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("vehiclemodels", reason="the extra [commonroad] is not installed")
pytest.importorskip("fmpy", reason="the extra [fmu] is not installed")
pytest.importorskip("pythonfmu", reason="the extra [test] is not installed")

from made_fmus import FOREIGN_MAPPING, make_foreign_car
from virtual_drive import SHORT_LANE_CHANGE

from rt_controller import cli, simulate
from rt_controller.contract.errors import ConfigError, PlantError
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput
from rt_controller.settings import CarSettings
from sim_bridge.adapters.commonroad import (
    BRAKE_MPS2_PER_N,
    FULL_THROTTLE_MPS2,
    STEERING_RATIO,
    CommonRoadPlant,
    commanded_mps2,
)
from sim_bridge.car import Car
from sim_bridge.scenario import load_scenario
from sim_bridge.session import build_car

CRUISE_22 = 0.068
"""throttle that about holds 22 m/s"""


def run(car: Car, control: ControlInput, periods: int) -> None:
    for _ in range(periods):
        car.advance(control, 0.0)


def test_the_steady_turn_of_vehicle_2_has_the_yaw_rate_of_the_model() -> None:
    """0.02 rad at the road wheels and 22.2 m/s: 10.0 deg/s, roll 3.5 deg, to the side it should."""
    car = Car(CommonRoadPlant(2, 1.0), 22.2)
    steer_rad = 0.02 * STEERING_RATIO
    run(car, ControlInput(CRUISE_22, 0.0, steer_rad), 120)
    assert car.state.vx_mps == pytest.approx(22.2, abs=0.15)
    assert np.degrees(car.state.yaw_rate_radps) == pytest.approx(10.02, rel=0.03)
    outputs = car.plant.outputs()
    assert np.degrees(outputs.roll_rad) == pytest.approx(3.53, rel=0.1)
    assert outputs.road_wheel_rad == pytest.approx(0.02)
    assert outputs.ay_mps2 == pytest.approx(car.state.yaw_rate_radps * car.state.vx_mps, rel=0.05)


def test_acceleration_is_proportional_to_the_pedals() -> None:
    standing = commanded_mps2(ControlInput(1.0, 0.0, 0.0), 0.0, 0.001)
    assert standing == pytest.approx(FULL_THROTTLE_MPS2, abs=0.06)
    coasting = commanded_mps2(NEUTRAL_INPUT, 30.0, 0.001)
    assert coasting < 0.0
    braking = commanded_mps2(ControlInput(0.0, 150.0, 0.0), 30.0, 0.001)
    assert braking - coasting == pytest.approx(-150.0 * BRAKE_MPS2_PER_N)
    fast = commanded_mps2(ControlInput(1.0, 0.0, 0.0), 40.0, 0.001)
    assert fast - commanded_mps2(NEUTRAL_INPUT, 40.0, 0.001) == pytest.approx(90.0 / 40.0)


def test_a_braked_car_pitches_forward_and_stops() -> None:
    car = Car(CommonRoadPlant(2, 0.85), 15.0)
    brake = ControlInput(0.0, 100.0, 0.2)
    run(car, brake, 40)
    assert car.plant.outputs().ax_mps2 == pytest.approx(-100.0 * BRAKE_MPS2_PER_N, rel=0.1)
    assert np.degrees(car.plant.outputs().pitch_rad) > 0.5
    run(car, brake, 140)
    s_m = car.s_m
    run(car, brake, 40)
    assert abs(car.state.vx_mps) < 1e-6
    assert abs(car.s_m - s_m) < 1e-3
    assert car.is_sound


def test_a_car_that_rolls_over_or_is_not_finite_has_failed() -> None:
    """The model itself continues, with accelerations of a hundred m/s^2."""
    car = Car(CommonRoadPlant(2, 1.0), 22.2)
    run(car, ControlInput(CRUISE_22, 0.0, 0.08 * STEERING_RATIO), 60)
    assert not car.is_sound
    assert "rolled over" in (car.plant.failure or "")
    car = Car(CommonRoadPlant(2, 0.85), 20.0)
    run(car, ControlInput(0.2, 0.0, nan), 2)
    assert not car.is_sound
    assert "commonroad:2: at 0.001 s" in (car.plant.failure or "")
    car.reset(20.0)
    run(car, NEUTRAL_INPUT, 2)
    assert car.is_sound


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


def test_commonroads_car_is_driven_through_the_lane_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The controller's model was not learned from this car."""
    code, figures = drive(
        tmp_path, monkeypatch, "--plant", "commonroad:2", "--scenario", SHORT_LANE_CHANGE
    )
    assert code == 0
    assert figures["final_mode"] == "STANDBY"
    assert figures["ey_peak_m"] <= 0.5


def test_a_car_that_follows_its_wheel_later_does_not_oscillate_at_speed(tmp_path: Path) -> None:
    scenario = tmp_path / "motorway.toml"
    scenario.write_text(
        """format = 2
name = "a slight bend at 120 km/h"
duration_s = 15.0
metrics = ["ey_peak_m"]
[reference]
speed_kmh = { t_s = [0.0, 15.0], value = [120.0, 120.0] }
[road]
curvature_per_m = { s_m = [0.0, 100.0, 130.0, 160.0], value = [0.0, 0.0, 0.001, 0.0] }
"""
    )
    drive = simulate(scenario, plant="commonroad:3")
    assert drive.stop_s is None
    assert drive.car_figures[0].value <= 0.1


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


def test_a_plant_is_refused_before_the_drive_if_it_has_no_friction_or_no_first_period(
    tmp_path: Path,
) -> None:
    mapping = FOREIGN_MAPPING.replace('road_friction = "mu"\n', "")
    fmu = make_foreign_car(tmp_path, "Refused", mapping)
    with pytest.raises(ConfigError, match="`friction`: expected an FMU whose mapping"):
        build_car(load_scenario("straight"), CarSettings(plant=f"fmu:{fmu}", friction=0.4))
    fmu.with_suffix(".toml").write_text(mapping.replace("trailers = 1", "fails_at_s = 0.0"))
    with pytest.raises(ConfigError, match="drives a first control period"):
        build_car(load_scenario("straight"), CarSettings(plant=f"fmu:{fmu}"))
