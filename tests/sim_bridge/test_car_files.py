"""Car files: what is read, and what is refused with the names of the fields; changed cars."""

import re
import tomllib
from importlib import resources
from pathlib import Path

import pytest

from rt_controller.contract.errors import ConfigError
from sim_bridge.plant.parameters import (
    Parameters,
    default_car,
    load_parameters,
    with_cornering_stiffness,
    with_mass_factor,
    with_payload,
    with_road,
    with_road_friction,
)
from sim_bridge.plant.parts import NO_PAYLOAD, Payload, RoadParameters
from sim_bridge.plant.shipped_cars import shipped_cars

CAR = default_car()
CARS = resources.files("sim_bridge") / "cars"
TEXT = (CARS / "c_class_150kw_awd.toml").read_text("utf-8")
KNOWN_SOURCES = r"public data|derived: |estimate: |CommonRoad |as the default car: "
DRAG = 'drag = { value = 0.30, source = "public data" }'
LOAD = Payload(300.0, -1.2, 0.7)


def with_value(field: str, value: str) -> str:
    """The default car's file with another value of one field, the first of that name."""
    changed, count = re.subn(
        rf"^{field} = \{{ value = [^\]\n]*?\]?, source", f"{field} = {{ value = {value}, source",
        TEXT, count=1, flags=re.MULTILINE,
    )  # fmt: skip
    assert count == 1
    return changed


def load(text: str, folder: Path) -> Parameters:
    path = folder / "car.toml"
    path.write_text(text, encoding="utf-8")
    return load_parameters(path)


def test_cars_load_by_name_or_path(tmp_path: Path) -> None:
    assert shipped_cars() == [
        "c_class_125kw_fwd",
        "c_class_150kw_awd",
        "c_class_150kw_bev",
        "commonroad_vehicle_2",
    ]
    assert load_parameters("c_class_150kw_awd") == load(TEXT, tmp_path) == CAR
    assert load_parameters("c_class_125kw_fwd").driveline.front_share == 1.0
    assert load_parameters("commonroad_vehicle_2").body.mass_kg == pytest.approx(1093.3, abs=0.01)


@pytest.mark.parametrize("name", shipped_cars())
def test_every_number_of_a_shipped_car_has_a_source(name: str) -> None:
    """A source is published, derived, estimated, or another model."""
    for part, fields in tomllib.loads((CARS / f"{name}.toml").read_text("utf-8")).items():
        for field, entry in fields.items():
            assert re.match(KNOWN_SOURCES, entry["source"]), f"{part}.{field}"


@pytest.mark.parametrize(
    ("field", "value", "named"),
    [
        ("mass_kg", "-1501.0", "body.mass_kg: expected more than 0.0, found -1501.0"),
        ("mass_kg", "1600.0", "body.mass_kg: expected the sum of sprung and unsprung"),
        ("track_rear_m", "nan", "body.track_rear_m: expected a finite number, found nan"),
        ("rear_axle_m", "2.5", "body.rear_axle_m: expected the wheelbase"),
        ("front_axle_m", "1.35", "body.front_axle_m: expected the centre of gravity of the masses"),
        ("rolling_radius_m", '"big"', "tyre.rolling_radius_m: expected a number, found 'big'"),
        ("ratios", "[3.5, 2.1, 2.2, 1.0, 0.7, 0.6]", "gearbox.ratios: expected ratios that decr"),
        ("up_rpm_full", "2000.0", "gearbox.up_rpm: expected up-shifts above"),
        ("lateral_relaxation_end_slip", "0.0175", "tyre.lateral_relaxation_end_slip: expected"),
        ("speed_limit_rpm", "600.0", "engine.speed_limit_rpm: expected more than idle_speed_rpm"),
    ],
)
def test_a_number_out_of_its_limits_is_refused_with_the_name_of_the_field(
    field: str, value: str, named: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=re.escape(named)):
        load(with_value(field, value), tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("lag_s =", "lag_ms =", r"brakes\.lag_s: expected a value.*\n.*lag_ms: no such"),
        ("[aero]", "[air]", r"aero: expected a value, found none\.\n  air: no such setting"),
        (DRAG, "drag = 0.30", r"aero\.drag: expected \{ value, source \}"),
        (DRAG, DRAG.replace("public data", " "), r"aero\.drag: expected a source in words"),
        ("[road]", "[road", "car .*car.toml"),
    ],
)
def test_a_file_with_missing_unknown_or_unsourced_fields_is_refused(
    old: str, new: str, named: str, tmp_path: Path
) -> None:
    head, tail = TEXT.split("[brakes]")
    with pytest.raises(ConfigError, match=named):
        load(f"{head}[brakes]{tail.replace(old, new, 1)}", tmp_path)


def test_an_unknown_car_is_refused_with_the_list_of_shipped_cars() -> None:
    with pytest.raises(ConfigError, match=r"expected one of c_class_125kw_fwd, .*\.toml"):
        load_parameters("limousine")
    with pytest.raises(ConfigError, match="expected a car file in UTF-8 that can be read"):
        load_parameters("no/such/car.toml")


def test_changed_cars_have_the_changed_numbers() -> None:
    """The stiffness in both kinds of tyres, the friction on both sides or on each."""
    soft, heavy = with_cornering_stiffness(CAR, 0.8), with_mass_factor(CAR, 1.1)
    assert soft.tyre.cornering_stiffness_npr == 0.8 * CAR.tyre.cornering_stiffness_npr
    assert soft.tyre_file.lky == 0.8 * CAR.tyre_file.lky
    assert heavy.body.sprung_roll_inertia_kgm2 == 1.1 * CAR.body.sprung_roll_inertia_kgm2
    assert with_road_friction(CAR, 0.5).road[:2] == (0.5, 0.5)
    assert with_road_friction(CAR, 0.5, 0.9).road[:2] == (0.5, 0.9)
    for change in (with_road_friction, with_cornering_stiffness, with_mass_factor):
        for number in (0.0, -0.9, float("nan"), float("inf")):
            with pytest.raises(ConfigError, match="expected a positive number"):
                change(CAR, number)


def test_an_impossible_road_is_refused_with_all_its_fields() -> None:
    names = r"(?s)friction_left: expected.*bank_rad: .*grade_rad: .*wind_left_mps: expected"
    with pytest.raises(ConfigError, match=names) as refused:
        with_road(CAR, RoadParameters(0.0, 0.8, 1.2, float("nan"), 0.0, float("inf")))
    assert "friction_right" not in str(refused.value)


def test_the_axle_loads_of_a_loaded_car_are_those_of_both_masses() -> None:
    before, after = CAR.body, with_payload(CAR, LOAD).body
    wheelbase_m = before.front_axle_m + before.rear_axle_m
    rear_kg = before.mass_kg * before.front_axle_m / wheelbase_m
    added_kg = LOAD.mass_kg * (before.front_axle_m - LOAD.ahead_m) / wheelbase_m
    assert after.mass_kg * after.front_axle_m / wheelbase_m == pytest.approx(rear_kg + added_kg)
    assert after.front_axle_m + after.rear_axle_m == pytest.approx(wheelbase_m)
    sprung_m = after.sprung_front_axle_m + after.sprung_rear_axle_m
    assert sprung_m == pytest.approx(before.sprung_front_axle_m + before.sprung_rear_axle_m)
    assert with_payload(CAR, NO_PAYLOAD) is CAR
    centred = with_payload(CAR, LOAD._replace(ahead_m=0.0)).body
    assert centred.yaw_inertia_kgm2 == pytest.approx(before.yaw_inertia_kgm2)


def test_two_loads_are_one_at_their_common_place() -> None:
    """The second is given from the centre of gravity that the first has moved."""
    half = LOAD._replace(mass_kg=150.0)
    once = with_payload(CAR, half)
    moved_m = once.body.front_axle_m - CAR.body.front_axle_m
    twice = with_payload(once, half._replace(ahead_m=half.ahead_m + moved_m))
    assert twice.body == pytest.approx(with_payload(CAR, LOAD).body)
