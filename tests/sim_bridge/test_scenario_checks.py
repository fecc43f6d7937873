"""Checks of a scenario before its drive: plant, friction, steering wheel."""

from typing import Any

import numpy as np
import pytest

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput
from rt_controller.contract.timing import PERIOD_S
from rt_controller.settings import CarSettings
from sim_bridge.adapters.own_car import OwnCar
from sim_bridge.car import Car
from sim_bridge.plant.parameters import default_car
from sim_bridge.plant.protocol import PlantOutputs, RoadAt
from sim_bridge.scenario import Scenario, load_scenario, parse_scenario
from sim_bridge.scenario_checks import grip_note, require_road, steering_note
from sim_bridge.session import build_car

SPLIT = {"friction_left": 0.85, "friction_right": 0.2}
PATCH = {"friction": {"s_m": [0.0, 30.0], "value": [0.85, 0.2], "interpolation": "step"}}


def scenario(road: dict[str, Any] | None = None, **parts: Any) -> Scenario:
    content = {
        "format": 2, "name": "x", "duration_s": 5.0, "reference": {"speed_kmh": 72.0},
        "road": road or {},
    }  # fmt: skip
    return parse_scenario(content | parts, "test")


@pytest.mark.parametrize("road", [SPLIT, PATCH])
def test_a_plant_with_one_friction_is_refused_where_it_changes(road: dict[str, Any]) -> None:
    require_road(OwnCar(default_car()), scenario(road))
    require_road(UniformCar(), scenario({"friction_left": 0.4, "friction_right": 0.4}))
    with pytest.raises(ConfigError, match=r"takes road.friction.*, found uniform"):
        require_road(UniformCar(), scenario(road))


class UniformCar:
    """A plant that is not told of its road."""

    name, failure = "uniform", None

    def reset(self, v0_mps: float) -> np.ndarray:
        return np.array([v0_mps, 0.0, 0.0])

    def step(self, control: ControlInput, dt_s: float) -> np.ndarray:
        return np.zeros((1, 3))

    def outputs(self) -> PlantOutputs:
        return PlantOutputs()

    def close(self) -> None: ...


class LevelCar(OwnCar):
    """The own car, on level roads without wind."""

    road_inputs = frozenset({"friction_left", "friction_right"})


@pytest.mark.parametrize(
    ("road", "parts", "field"),
    [
        ({"bank_deg": 2.0}, {}, "road.bank_deg"),
        ({"grade_percent": -3.0}, {}, "road.grade_percent"),
        ({}, {"cross_wind_mps": 5.0}, "cross_wind_mps"),
        ({}, {"tail_wind_mps": {"t_s": [0.0, 3.0], "value": [0.0, 9.0]}}, "tail_wind_mps"),
    ],
)
def test_what_a_plant_does_not_take_is_refused_by_name(road, parts, field: str) -> None:
    with pytest.raises(ConfigError, match=f"expected a plant that takes {field}, found"):
        require_road(LevelCar(default_car()), scenario(road, **parts))


def coasted(road: dict[str, Any], **parts: Any) -> tuple[float, float]:
    """Speed and lateral position after two seconds without pedals and steering."""
    drive = scenario(road, **parts)
    car = build_car(drive)
    require_road(car.plant, drive)
    for tick in range(80):
        car.set_road(drive.road_at(car.s_m, tick * PERIOD_S))
        car.advance(NEUTRAL_INPUT, drive.road.curvature_per_m)
    return car.state.vx_mps, car.state.ey_m


def test_slopes_and_wind_of_a_scenario_act_on_the_own_car() -> None:
    speed_mps, ey_m = coasted({})
    assert coasted({"grade_percent": 6.0})[0] < speed_mps - 0.8
    assert coasted({"grade_percent": -6.0})[0] > speed_mps + 0.8
    assert coasted({}, tail_wind_mps=15.0)[0] > speed_mps + 0.05
    assert coasted({"bank_deg": 3.0})[1] < ey_m - 0.05
    assert coasted({"bank_deg": -3.0})[1] > ey_m + 0.05
    assert coasted({}, cross_wind_mps=15.0)[1] > ey_m + 0.02
    assert coasted({}, cross_wind_mps=-15.0)[1] < ey_m - 0.02


def test_a_drive_that_begins_on_a_hill_begins_with_the_throttle_for_it() -> None:
    level, hill = (
        build_car(scenario(road)).plant.outputs().throttle for road in ({}, {"grade_percent": 6.0})
    )
    assert hill > level + 0.03


def test_a_payload_makes_the_car_slower_and_is_for_the_own_car_only() -> None:
    def speed_after_launch(payload: dict[str, float]) -> float:
        car = build_car(scenario(payload=payload))
        for _ in range(80):
            car.advance(ControlInput(1.0, 0.0, 0.0), 0.0)
        return car.state.vx_mps

    assert speed_after_launch({"mass_kg": 400.0}) < speed_after_launch({"mass_kg": 0.0}) - 0.3
    with pytest.raises(ConfigError, match="payload: expected --plant own"):
        build_car(scenario(payload={"mass_kg": 100.0}), CarSettings(plant="commonroad:2"))


def test_the_drive_begins_at_the_initial_place() -> None:
    drive = scenario(initial={"s_m": 12.0, "ey_m": 0.4, "epsi_deg": 3.0, "speed_kmh": 36.0})
    car = build_car(drive)
    assert (car.s_m, car.state.ey_m) == (12.0, 0.4)
    assert car.state.epsi_rad == pytest.approx(np.radians(3.0))
    assert car.state.vx_mps == pytest.approx(10.0)


class ListeningCar(OwnCar):
    """The own car, which keeps what it was told of its road."""

    road_inputs = frozenset(RoadAt._fields)
    told: RoadAt

    def set_road(self, road: RoadAt) -> None:
        self.told = road


def test_the_wind_is_told_in_the_axes_of_the_car() -> None:
    plant = ListeningCar(default_car())
    drive = scenario({"bank_deg": 3.0}, cross_wind_mps=6.0, tail_wind_mps=2.0)
    car = Car(plant, 20.0)
    car.reset(20.0, epsi_rad=np.pi / 2)
    car.set_road(drive.road_at(0.0, 0.0))
    told = plant.told
    assert (told.wind_forward_mps, told.wind_left_mps) == pytest.approx((6.0, -2.0))
    assert told.bank_rad == pytest.approx(np.radians(3.0))


def test_too_little_friction_is_noted_with_place_demand_and_grip() -> None:
    bend = scenario({"curvature_per_m": 0.02}, reference={"speed_kmh": 60.0})
    note = grip_note(bend.with_friction(0.5)) or ""
    assert "scenario 'x' with this --friction: reference.speed_kmh: expected a lateral" in note
    assert "below the grip of 4.9 m/s^2, found 5.6 m/s^2 at 60 km/h, s = 0.0 m" in note
    assert note.endswith("It is driven all the same.")
    assert grip_note(bend.with_friction(0.6)) is None


@pytest.mark.parametrize(
    ("radius_m", "speed_kmh", "text"),
    [
        (15.0, 30.0, "about 218 deg at the steering wheel at s = 0 m (radius 15 m, 30 km/h)"),
        (70.0, 85.0, "radius 70 m, 85 km/h"),
        (40.0, 30.0, None),
        (100.0, 40.0, None),
        (80.0, 10.0, None),
    ],
)
def test_a_bend_that_needs_too_much_steering_is_noted(
    radius_m: float, speed_kmh: float, text: str | None
) -> None:
    bend = scenario({"curvature_per_m": -1.0 / radius_m}, reference={"speed_kmh": speed_kmh})
    note = steering_note(bend)
    assert note is None if text is None else text in str(note)


@pytest.mark.parametrize("name", ["lane_change_60", "sine_60", "road_course"])
def test_short_peaks_of_steering_have_no_note(name: str) -> None:
    assert steering_note(load_scenario(name)) is None
