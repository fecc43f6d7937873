"""Scenarios: the fields of a file, what is refused by name, and checks before a drive."""

from copy import deepcopy
from dataclasses import replace
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from kinematic_plant import KinematicCar

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput
from rt_controller.contract.timing import PERIOD_S
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.path_kinematics import Movement
from rt_controller.model.validity import Validity
from rt_controller.settings import CarSettings
from sim_bridge.adapters.own_car import OwnCar
from sim_bridge.car import Car
from sim_bridge.plant.parameters import default_car
from sim_bridge.plant.protocol import RoadAt
from sim_bridge.scenario import Scenario, load_scenario, parse_scenario
from sim_bridge.scenario_checks import notes, require_road
from sim_bridge.session import build_car

GOOD: dict[str, Any] = {
    "format": 2,
    "name": "good",
    "duration_s": 20.0,
    "initial": {"speed_kmh": 70.0, "s_m": 5.0, "ey_m": 0.2, "epsi_deg": 1.0},
    "road": {
        "curvature_per_m": {"s_m": [0.0, 100.0], "value": [0.0, 0.002]},
        "friction": 0.9,
        "bank_deg": 2.0,
        "grade_percent": {"s_m": [0.0, 50.0], "value": [0.0, 4.0], "interpolation": "pchip"},
        "width_m": 8.0,
    },
    "reference": {"speed_kmh": 72.0, "ey_m": {"s_m": [20.0, 90.0], "value": [0.0, 1.0],
                                              "interpolation": "pchip"}},
    "cross_wind_mps": {"t_s": [0.0, 2.0], "value": [0.0, 8.0]},
    "payload": {"mass_kg": 150.0, "ahead_m": -1.0},
    "stops": [{"at_s_m": 200.0, "hold_s": 2.0}],
    "faults": [{"kind": "state_lost", "start_s": 3.0, "duration_s": 0.05}],
    "metrics": ["creep_m"],
    "limits": {"ey_peak_m": 0.5},
}  # fmt: skip


def changed(path: str, value: Any) -> dict[str, Any]:
    """The good content with another value."""
    content = deepcopy(GOOD)
    *folders, name = (int(part) if part.isdigit() else part for part in path.split("/"))
    table: Any = content
    for folder in folders:
        table = table[folder]
    table[name] = value
    return content


def require_refused(content: dict[str, Any], fields: str, text: str = "") -> None:
    """`fields` are those that the lines of the message begin with."""
    with pytest.raises(ConfigError, match=r"^test:") as refused:
        parse_scenario(content, "test")
    lines = str(refused.value).removeprefix("test:").strip().splitlines()
    assert list(dict.fromkeys(line.partition(":")[0].strip() for line in lines)) == fields.split()
    assert text in str(refused.value)


def test_the_fields_of_a_file_are_those_of_the_scenario() -> None:
    scenario: Scenario = parse_scenario(GOOD, "test")
    assert scenario.start.speed_mps == pytest.approx(70.0 / 3.6)
    assert scenario.start.epsi_rad == pytest.approx(radians(1.0))
    ground = scenario.road_at(100.0, 2.0)
    assert ground.curvature_per_m == pytest.approx(0.002)
    assert ground.friction_left == ground.friction_right == 0.9
    assert ground.bank_rad == pytest.approx(radians(2.0))
    assert ground.grade_rad == pytest.approx(0.04, abs=1e-4)
    assert ground.wind_left_mps == 8.0
    assert scenario.payload.mass_kg == 150.0
    assert scenario.stops[0].hold_s == 2.0
    assert scenario.faults[0].ticks == range(120, 122)
    assert scenario.limits == {"ey_peak_m": 0.5}


SPEED, EY, BENDS = "reference.speed_kmh", "reference.ey_m", "road.curvature_per_m.bends[0]"
WRONG_MOVES = [{"start_m": 10.0, "length_m": 40.0, "to_m": 1.0},
               {"start_m": 30.0, "length_m": 40.0, "to_m": 0.0}]  # fmt: skip


def course(**bend: float) -> dict[str, Any]:
    return {"kind": "course", "bends": [bend]}


@pytest.mark.parametrize(
    ("path", "value", "field"),
    [
        ("format", 3, "format"),
        ("name", "", "name"),
        ("duration_s", 0.0, "duration_s"),
        ("initial", {"ey_m": 50.0, "s_m": -1.0}, "initial.s_m initial.ey_m"),  # all at once
        ("reference/speed_kmh", 300.0, SPEED),
        ("reference/speed_kmh", {"t_s": [0.0, 1e308], "value": [50.0, 9.0]}, f"{SPEED}.t_s[1]"),
        ("reference/speed_kmh", {"t_s": [0.0, 1.0], "value": [50.0]}, f"{SPEED}.value"),
        ("reference/speed_kmh", {"t_s": [1.0, 0.0], "value": [50.0, 9.0]}, f"{SPEED}.t_s"),
        ("reference/speed_kmh", {"t_s": [0.0], "s_m": [0.0], "value": [50.0]}, f"{SPEED}.s_m"),
        ("reference/speed_kmh", {"s_m": [0.0, 9.0], "value": [0.0, 9.0]}, f"{SPEED}.value"),
        ("reference/speed_kmh", {"s_m": [0.0], "value": [50.0], "interpolation": "step"},
         f"{SPEED}.interpolation"),
        ("reference/speed_kmh", {"kind": "stop_and_go"}, SPEED),
        ("reference/ey_m", 11.0, EY),
        ("reference/ey_m", {"kind": "slalom", "start_m": 5.0, "spacing_m": 40.0, "cones": 3},
         f"{EY}.start_s_m {EY}.start_m"),
        ("reference/ey_m", {"kind": "sine", "amplitude_m": 1.0}, f"{EY}.wavelength_m"),
        ("reference/ey_m", {"kind": "sine", "amplitude_m": 0.01, "wavelength_m": 1.5},
         f"{EY}.wavelength_m"),
        ("reference/ey_m", {"kind": "iso_3888_1", "start_s_m": 20.0, "clearance_m": 1.0},
         f"{EY}.clearance_m"),
        ("reference/ey_m", {"kind": "moves", "moves": WRONG_MOVES}, f"{EY}.moves[1].start_m"),
        ("reference/ey_m", {"s_m": [20.0, 20.1, 20.2], "value": [0.0, 0.02, 0.0]}, f"{EY}.s_m"),
        ("reference/ey_m", {"s_m": [20.0, 23.0], "value": [0.0, 3.0]}, EY),  # its slope
        ("reference/ey_m", {"kind": "sine", "amplitude_m": 1.0, "frequency_hz": 0.2}, EY),
        ("reference/ey_m", 3.5, EY),  # beside the road
        ("road/curvature_per_m", [0.0, 0.01], "road.curvature_per_m"),
        ("road/curvature_per_m", course(radius_m=5.0, turn_deg=9.0), f"{BENDS}.radius_m"),
        ("road/curvature_per_m", course(radius_m=50.0), f"{BENDS}.turn_deg"),
        ("road/curvature_per_m", course(radius_m=50.0, turn_deg=30.0, spiral_m=40.0),
         f"{BENDS}.spiral_m"),
        ("road/friction", {"s_m": [0, 9], "value": [0.5, 2.0]}, "road.friction"),
        ("road/friction_left", 0.5, "road.friction"),
        ("road/opendrive", {"file": "a.xodr"}, "road.bank_deg"),
        ("road/length_m", 4.0, "initial.s_m"),
        ("stops/0/at_s_m", 20.0, "stops"),
        ("stops/0/at_s_m", 900.0, "stops"),
        ("faults/0/duration_s", 1e-9, "faults[0].duration_s"),
        ("faults/0/start_s", 20.0, "faults[0].start_s"),
        ("faults", [{"kind": "lost", "signal": "ey", "start_s": "3", "duration_s": -1.0}],
         "faults[0].kind faults[0].start_s faults[0].duration_s faults[0].signals[0]"),
        ("limits", {"beauty": 1.0}, "limits.beauty"),
    ],
)  # fmt: skip
def test_a_field_that_does_not_fit_is_refused_by_name(path: str, value: Any, field: str) -> None:
    require_refused(changed(path, value), field)


def test_a_misspelt_field_is_told_the_nearest_one_of_its_own_table() -> None:
    for path, near in (("road/lenght_m", "length_m"), ("stops/0/at_s", "at_s_m")):
        fields = path.replace("/0/", "[0].").replace("/", ".")
        require_refused(changed(path, 3.0), fields, f"(did you mean {near}?)")


def test_a_file_that_is_no_toml_or_not_there_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    path.write_text("format = ")
    with pytest.raises(ConfigError, match="expected a TOML file"):
        load_scenario(str(path))
    with pytest.raises(ConfigError, match=r"double_lane_change.*did you mean double_lane_chan"):
        load_scenario("dubble_lane_change")


PLAIN: dict[str, Any] = {
    "format": 2, "name": "good", "duration_s": 30.0, "reference": {"speed_kmh": 60.0},
}  # fmt: skip
ICE_LATER = {"friction": {"s_m": [0.0, 120.0], "value": [0.9, 0.1], "interpolation": "step"}}
ICE_SOON = {"friction": {"s_m": [0.0, 30.0], "value": [0.9, 0.1], "interpolation": "step"}}
BRAKING = {"speed_kmh": {"t_s": [0.0, 1.0, 3.0], "value": [60.0, 60.0, 30.0]}}
TIME_SINE = {"kind": "sine", "amplitude_m": 0.5, "frequency_hz": 0.4}
LATE_MOVE = {"kind": "moves", "moves": [{"start_m": 30_000.0, "length_m": 20.0, "to_m": 5.0}]}


def plain(**parts: Any) -> Scenario:
    return parse_scenario(PLAIN | parts, "test")


@pytest.mark.parametrize(
    ("field", "text", "parts"),
    [
        ("stops.deceleration_mps2", "grip of 1.0 m/s^2",
         {"road": {"friction": 0.1}, "stops": [{"at_s_m": 160.0, "deceleration_mps2": 3.0}]}),
        ("stops.acceleration_mps2", "grip of 1.5 m/s^2",
         {"road": {"friction": 0.15}, "initial": {"speed_kmh": 0.0},
          "stops": [{"at_s_m": 80.0, "deceleration_mps2": 1.0}]}),
        ("stops.deceleration_mps2", "found -2.5 m/s^2 on a slope of -10.0 %",
         {"road": {"grade_percent": -10.0, "friction": 0.25}, "stops": [{"at_s_m": 200.0}]}),
        (SPEED, "", {"road": ICE_SOON, "reference": BRAKING}),
        (SPEED, "found 27.8 m/s^2",
         {"reference": {"speed_kmh": {"t_s": [0.0, 1.0], "value": [0.0, 100.0]}}}),
        ("stops", "braking distance of 55.6 m",
         {"stops": [{"at_s_m": 20.0, "hold_s": 3.0}, {"at_s_m": 300.0}]}),
        (EY, "the next 1.1 s or 4 m",
         {"initial": {"speed_kmh": 0.0}, "reference": {"speed_kmh": 60.0, "ey_m": TIME_SINE}}),
        (SPEED, "found 30.9 m/s^2 at 200 km/h, s = 0.0 m, the bank included. The radius there is "
         "100 m, on which less than 104 km/h is possible.",
         {"initial": {"speed_kmh": 200.0}, "road": {"curvature_per_m": 0.01}}),
        (SPEED, "less than 77 km/h is possible",
         {"road": {"curvature_per_m": -0.02, "bank_deg": 5.0}, "reference": {"speed_kmh": 80.0}}),
        ("stops", "100.4 m",
         {"stops": [{"at_s_m": 100.0, "hold_s": 1.0}, {"at_s_m": 100.4}]}),
        (EY, "grip of 8.3 m/s^2",
         {"duration_s": 3600.0, "reference": {"speed_kmh": 50.0, "ey_m": LATE_MOVE}}),
    ],
)  # fmt: skip
def test_what_the_road_cannot_carry_is_refused_by_its_field(
    field: str, text: str, parts: dict[str, Any]
) -> None:
    require_refused(PLAIN | parts, field, text)


def test_what_the_road_can_carry_is_not_refused_for_another_place() -> None:
    plain(road=ICE_LATER, reference=BRAKING, duration_s=10.0)
    plain(road=ICE_LATER, stops=[{"at_s_m": 100.0, "deceleration_mps2": 6.0}])
    plain(road={"curvature_per_m": 0.02, "bank_deg": -8.0, "friction": 0.5})
    plain(road={"grade_percent": 10.0, "friction": 0.25}, stops=[{"at_s_m": 200.0}])


SPLIT = {"friction_left": 0.85, "friction_right": 0.2}
PATCH = {"friction": {"s_m": [0.0, 30.0], "value": [0.85, 0.2], "interpolation": "step"}}


def on_road(road: dict[str, Any] | None = None, **parts: Any) -> Scenario:
    content = {
        "format": 2, "name": "x", "duration_s": 5.0, "reference": {"speed_kmh": 72.0},
        "road": road or {},
    }  # fmt: skip
    return parse_scenario(content | parts, "test")


@pytest.mark.parametrize(
    ("road", "parts", "field"),
    [
        ({"bank_deg": 2.0}, {}, "road.bank_deg"),
        ({"grade_percent": -3.0}, {}, "road.grade_percent"),
        ({}, {"cross_wind_mps": 5.0}, "cross_wind_mps"),
        ({}, {"tail_wind_mps": {"t_s": [0.0, 3.0], "value": [0.0, 9.0]}}, "tail_wind_mps"),
    ],
)
def test_what_a_plant_does_not_take_is_refused_by_name(
    monkeypatch: pytest.MonkeyPatch, road: dict[str, Any], parts: dict[str, Any], field: str
) -> None:
    level = frozenset({"friction_left", "friction_right"})
    monkeypatch.setattr(OwnCar, "road_inputs", level)
    with pytest.raises(ConfigError, match=f"expected a plant that takes {field}, found"):
        require_road(OwnCar(default_car()), on_road(road, **parts))


def coasted(road: dict[str, Any], **parts: Any) -> tuple[float, float]:
    """Speed and lateral position after two seconds without pedals and steering."""
    drive = on_road(road, **parts)
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


def test_a_payload_makes_the_car_slower_and_is_for_the_own_car_only() -> None:
    def speed_after_launch(payload: dict[str, float]) -> float:
        car = build_car(on_road(payload=payload))
        for _ in range(80):
            car.advance(ControlInput(1.0, 0.0, 0.0), 0.0)
        return car.state.vx_mps

    assert speed_after_launch({"mass_kg": 400.0}) < speed_after_launch({"mass_kg": 0.0}) - 0.3
    with pytest.raises(ConfigError, match="payload: expected --plant own"):
        build_car(on_road(payload={"mass_kg": 100.0}), CarSettings(plant="commonroad:2"))


def test_a_plant_with_one_friction_is_refused_where_it_changes() -> None:
    require_road(KinematicCar(), on_road({"friction_left": 0.4, "friction_right": 0.4}))
    for road in (SPLIT, PATCH):
        require_road(OwnCar(default_car()), on_road(road))
        with pytest.raises(ConfigError, match=r"takes road.friction.*, found kinematic"):
            require_road(KinematicCar(), on_road(road))


def test_the_drive_begins_at_the_initial_place() -> None:
    drive = on_road(initial={"s_m": 12.0, "ey_m": 0.4, "epsi_deg": 3.0, "speed_kmh": 36.0})
    car = build_car(drive)
    assert (car.s_m, car.state.ey_m) == (12.0, 0.4)
    assert car.state.epsi_rad == pytest.approx(np.radians(3.0))
    assert car.state.vx_mps == pytest.approx(10.0)


def test_the_wind_is_told_in_the_axes_of_the_car(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[RoadAt] = []
    monkeypatch.setattr(OwnCar, "set_road", lambda plant, road: told.append(road))
    drive = on_road({"bank_deg": 3.0}, cross_wind_mps=6.0, tail_wind_mps=2.0)
    car = Car(OwnCar(default_car()), 20.0)
    car.reset(20.0, epsi_rad=np.pi / 2)
    car.set_road(drive.road_at(0.0, 0.0))
    assert (told[-1].wind_forward_mps, told[-1].wind_left_mps) == pytest.approx((6.0, -2.0))
    assert told[-1].bank_rad == pytest.approx(np.radians(3.0))


def test_too_little_friction_is_noted_with_place_demand_and_grip() -> None:
    bend = on_road({"curvature_per_m": 0.02}, reference={"speed_kmh": 60.0})
    (note,) = notes(bend.with_friction(0.5), True)
    assert "scenario 'x' with this --friction: reference.speed_kmh: expected a lateral" in note
    assert "below the grip of 4.9 m/s^2, found 5.6 m/s^2 at 60 km/h, s = 0.0 m" in note
    assert note.endswith("It is driven all the same.")
    assert not list(notes(bend.with_friction(0.5), False))
    assert not list(notes(bend.with_friction(0.6), True))


@pytest.mark.parametrize(
    ("radius_m", "speed_kmh", "text"),
    [
        (9.5, 30.0, "deg at the steering wheel at s = 0 m (radius 10 m, 30 km/h)"),
        (70.0, 85.0, "radius 70 m, 85 km/h"),
        (40.0, 30.0, ""),
        (80.0, 10.0, ""),
    ],
)
def test_a_bend_that_needs_too_much_steering_is_noted_and_a_short_peak_is_not(
    radius_m: float, speed_kmh: float, text: str
) -> None:
    bend = on_road({"curvature_per_m": -1.0 / radius_m}, reference={"speed_kmh": speed_kmh})
    found = list(notes(bend, False))
    assert text in str(found)
    assert bool(found) is bool(text)
    assert not list(notes(load_scenario("lane_change_60"), False))


@pytest.mark.parametrize(
    ("road", "others", "is_path_exact", "text"),
    [
        ({"curvature_per_m": 0.025}, {}, False, "curvature 0.025 1/m at 45 km/h (the model was"),
        ({"curvature_per_m": 0.025}, {}, True, ""),
        ({"curvature_per_m": -0.045}, {}, True, "lateral acceleration 7 m/s² at 45 km/h"),
        ({"friction": 0.6}, {}, True, "friction 0.6 (trained 0.85)"),
        ({"friction": 0.9}, {}, True, ""),
        ({"grade_percent": -9.0}, {}, True, "grade -9 % (trained -3 to 3 %)"),
        ({"bank_deg": 4.0}, {}, True, "bank 4 deg (trained 0 deg)"),
        ({}, {"payload": {"mass_kg": 250.0}}, True, "load 250 kg (trained 0 kg)"),
        ({}, {"reference": {"speed_kmh": 150.0}}, True, "speed 150 km/h (the model was trained to"),
        ({}, {"reference": {"speed_kmh": 20.0}}, True, ""),
        ({"curvature_per_m": 0.15}, {"reference": {"speed_kmh": 20.0}}, True, ""),
        ({"grade_percent": 7.0, "friction": 0.5}, {}, True, "friction 0.5 (trained 0.85); grade 7"),
    ],
)
def test_a_scenario_that_leaves_the_training_of_the_model_is_named(
    road: dict[str, object], others: dict[str, object], is_path_exact: bool, text: str
) -> None:
    validity = Validity(
        np.array([8.0, 40.0]),
        np.array([6.0, 8.0]),
        np.array([5.0, 1.0]),
        np.array([0.004, 0.004]),
        np.array([[0.85, 0.85], [-0.03, 0.03], [0.0, 0.0], [0.0, 0.0]]),
    )
    model = replace(load_bundle(shipped_model("lti")), validity=validity)
    if is_path_exact:
        model = replace(model, movement=Movement(np.zeros((3, 6)), np.zeros(3)))
    scenario = on_road(road, **{"reference": {"speed_kmh": 45.0}, **others})
    found = [note for note in notes(scenario, False, model) if "trained" in note]
    assert text in str(found)
    assert bool(found) is bool(text)
    unknown = replace(model, validity=None)
    assert "trained" not in str(list(notes(scenario, False, unknown)))
