"""Corners at low speed: the whole lock of the car, near the path, with other cars and sensors."""

from pathlib import Path
from typing import Any

import pytest

from rt_controller import simulate
from rt_controller.config import ControllerConfig
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import Mode
from sim_bridge import parse_scenario
from sim_bridge.scenario import Scenario

CARS = Path(__file__).parents[2] / "sim_bridge" / "cars"
LARGEST_EY_M = 0.3
NOISE = [
    {"kind": "noise", "signals": [signal], "value": value, "seed": seed}
    for seed, (signal, value) in enumerate(
        {
            "vx_mps": 0.02, "vy_mps": 0.02, "yaw_rate_radps": 0.003, "ey_m": 0.01,
            "epsi_rad": 0.001,
        }.items()
    )
]  # fmt: skip
TURN = {"kind": "course", "bends": [
    {"straight_m": 10.0, "radius_m": 8.0, "turn_deg": 180.0}, {"straight_m": 20.0},
]}  # fmt: skip


def u_turn(**changes: Any) -> Scenario:
    content = {
        "format": 2, "name": "U-turn", "duration_s": 25.0, "initial": {"speed_kmh": 7.2},
        "road": {"curvature_per_m": TURN}, "reference": {"speed_kmh": 7.2},
    }  # fmt: skip
    return parse_scenario({**content, **changes}, "test")


@pytest.mark.parametrize(
    ("name", "car"), [("u_turn", "c_class_150kw_awd"), ("corner", "c_class_150kw_bev")]
)
def test_a_corner_is_driven_near_its_path(name: str, car: str) -> None:
    driven = simulate(name, car=car)
    assert driven.ending == "the mission is over"
    assert driven.errors.ey_peak_m < LARGEST_EY_M
    assert set(driven.modes) <= {Mode.STANDBY, Mode.LOW_SPEED}
    assert abs(driven["steer_rad"]).max() > 3.0


def test_noise_of_the_sensors_does_not_turn_the_car_off_its_path() -> None:
    driven = simulate(u_turn(faults=NOISE))
    assert driven.ending == "the mission is over"
    assert driven.errors.ey_peak_m < LARGEST_EY_M


def test_a_car_with_another_ratio_and_lock_turns_too(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    text = (CARS / "c_class_150kw_awd.toml").read_text("utf-8")
    own.write_text(text.replace("ratio = { value = 18.5", "ratio = { value = 14.0"), "utf-8")
    config = ControllerConfig(low_speed={"steering_ratio": 14.0, "lock_rad": 7.5})
    driven = simulate("u_turn", car=str(own), config=config)
    assert driven.ending == "the mission is over"
    assert driven.errors.ey_peak_m < LARGEST_EY_M


def test_a_car_stops_and_starts_inside_its_turn() -> None:
    speed = {"kind": "stop_and_go", "cruise_kmh": 7.2, "first_stop_s_m": 20.0, "spacing_m": 20.0,
             "count": 1, "hold_s": 2.0}  # fmt: skip
    driven = simulate(u_turn(reference={"speed_kmh": speed}, initial={"speed_kmh": 0.0}))
    assert {Mode.STANDSTILL, Mode.LOW_SPEED} <= set(driven.modes)
    assert Mode.SAFE_STOP not in driven.modes
    assert driven.errors.ey_peak_m < LARGEST_EY_M


def test_the_model_takes_over_when_the_wheel_is_within_the_bound_of_its_plan() -> None:
    course = {"kind": "course", "bends": [
        {"straight_m": 20.0, "radius_m": 20.0, "turn_deg": 90.0}, {"straight_m": 150.0},
    ]}  # fmt: skip
    speed = {"kind": "curve_speed", "max_kmh": 50.0, "lateral_mps2": 2.0}
    content = {"road": {"curvature_per_m": course}, "reference": {"speed_kmh": speed}}
    driven = simulate(u_turn(initial={"speed_kmh": 22.0}, duration_s=15.0, **content))
    is_model = [mode is Mode.NOMINAL for mode in driven.modes]
    assert any(is_model)
    assert driven.ending == "the mission is over"
    assert abs(driven["steer_rad"][is_model]).max() <= INPUT_LIMITS.upper.steer_rad
    assert abs(driven["steer_rad"]).max() > 2.0
