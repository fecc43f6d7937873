"""Car files: what is read, and what is refused with the names of the fields."""

import re
import tomllib
from importlib import resources
from pathlib import Path

import numba
import pytest

from rt_controller.contract.errors import ConfigError
from sim_bridge.plant.car_record import car_record
from sim_bridge.plant.parameters import (
    Parameters,
    default_car,
    load_parameters,
    with_cornering_stiffness,
    with_road_friction,
)
from sim_bridge.plant.shipped_cars import shipped_cars

TEXT = (resources.files("sim_bridge") / "cars" / "c_class_150kw_awd.toml").read_text("utf-8")

KNOWN_SOURCES = r"public data|derived: |estimate: |CommonRoad |as the default car: "


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


def test_shipped_cars_load_by_name() -> None:
    assert shipped_cars() == [
        "c_class_125kw_fwd",
        "c_class_150kw_awd",
        "c_class_150kw_bev",
        "commonroad_vehicle_2",
    ]
    cars = {name: load_parameters(name) for name in shipped_cars()}
    assert cars["c_class_150kw_awd"] == default_car()
    assert cars["c_class_125kw_fwd"].driveline.front_share == 1.0
    assert cars["commonroad_vehicle_2"].body.mass_kg == pytest.approx(1093.3, abs=0.01)


def test_a_car_file_outside_the_package_loads_by_path(tmp_path: Path) -> None:
    assert load(TEXT, tmp_path) == default_car()


@pytest.mark.parametrize("name", shipped_cars())
def test_every_number_of_a_shipped_car_has_a_source(name: str) -> None:
    """A source is published, derived, estimated, or another model."""
    text = (resources.files("sim_bridge") / "cars" / f"{name}.toml").read_text("utf-8")
    for part, fields in tomllib.loads(text).items():
        for field, entry in fields.items():
            assert re.match(KNOWN_SOURCES, entry["source"]), f"{part}.{field}"


def test_the_commonroad_car_has_the_parameters_of_the_library() -> None:
    library = pytest.importorskip("vehiclemodels.parameters_vehicle2")
    theirs = library.parameters_vehicle2()
    ours = load_parameters("commonroad_vehicle_2")
    body, suspension, tyre = ours.body, ours.suspension, ours.tyre
    assert (body.mass_kg, body.sprung_mass_kg) == (theirs.m, theirs.m_s)
    assert (body.unsprung_front_kg, body.unsprung_rear_kg) == (theirs.m_uf, theirs.m_ur)
    assert (body.front_axle_m, body.rear_axle_m) == (theirs.a, theirs.b)
    assert (body.track_front_m, body.track_rear_m) == (theirs.T_f, theirs.T_r)
    assert body.yaw_inertia_kgm2 == theirs.I_z
    assert body.sprung_roll_inertia_kgm2 == theirs.I_Phi_s
    assert (suspension.spring_front_npm, suspension.spring_rear_npm) == (theirs.K_sf, theirs.K_sr)
    assert (suspension.bar_front_nmprad, suspension.bar_rear_nmprad) == (
        -theirs.K_tsf,
        -theirs.K_tsr,
    )
    assert suspension.jounce_front_nspm == suspension.rebound_front_nspm == theirs.K_sdf
    assert (tyre.vertical_stiffness_npm, tyre.rolling_radius_m) == (theirs.K_zt, theirs.R_w)
    assert (tyre.lateral_friction, tyre.lateral_shape) == (theirs.tire.p_dy1, theirs.tire.p_cy1)
    per_load = 2.0 * tyre.cornering_stiffness_npr / tyre.cornering_stiffness_load_n
    assert per_load == pytest.approx(-theirs.tire.p_ky1)


def test_all_shipped_cars_have_one_type_for_compiled_kernels() -> None:
    kind = numba.typeof(car_record(default_car()))
    assert all(numba.typeof(car_record(load_parameters(name))) == kind for name in shipped_cars())


@pytest.mark.parametrize(
    ("field", "value", "named"),
    [
        ("mass_kg", "-1501.0", "body.mass_kg: expected more than 0.0, found -1501.0"),
        ("mass_kg", "1600.0", "body.mass_kg: expected the sum of sprung and unsprung"),
        (
            "mass_kg",
            "1600.0",
            "sprung_mass_kg = 1369.0, sprung_front_axle_m = 1.0175, sprung_rear_axle_m = 1.8925",
        ),
        ("track_front_m", "0.0", "body.track_front_m: expected more than 0.0"),
        ("track_rear_m", "nan", "body.track_rear_m: expected a finite number, found nan"),
        ("rear_axle_m", "2.5", "body.rear_axle_m: expected the wheelbase"),
        ("sprung_front_axle_m", "inf", "body.sprung_front_axle_m: expected a finite number"),
        ("rolling_radius_m", '"big"', "tyre.rolling_radius_m: expected a number, found 'big'"),
        ("rolling_radius_m", "true", "tyre.rolling_radius_m: expected a number, found True"),
        (
            "ratios",
            "[3.538, 2.06, 2.10, 1.0, 0.713, 0.582]",
            "gearbox.ratios: expected ratios that decrease",
        ),
        ("ratios", "[3.538, 2.06, 1.0]", "gearbox.ratios: expected at least 6 entries"),
        ("final_efficiency", "1.2", "driveline.final_efficiency: expected at most 1"),
        ("up_rpm_full", "2000.0", "gearbox.up_rpm: expected up-shifts above"),
        (
            "lateral_relaxation_end_slip",
            "0.0175",
            "tyre.lateral_relaxation_end_slip: expected more than lateral_relaxation_start_slip",
        ),
        ("speed_limit_rpm", "600.0", "engine.speed_limit_rpm: expected more than idle_speed_rpm"),
    ],
)
def test_a_number_out_of_its_limits_is_refused_with_the_name_of_the_field(
    field: str, value: str, named: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=re.escape(named)):
        load(with_value(field, value), tmp_path)


def test_a_centre_of_gravity_that_contradicts_the_masses_is_refused(tmp_path: Path) -> None:
    text = with_value("front_axle_m", "1.2496")
    text = re.sub(r"^rear_axle_m = \{ value = [\d.]+", "rear_axle_m = { value = 1.6604", text,
                  flags=re.MULTILINE)  # fmt: skip
    with pytest.raises(
        ConfigError, match=r"body\.front_axle_m: expected the centre of gravity of the masses"
    ):
        load(text, tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        (
            "lag_s =",
            "lag_ms =",
            r"brakes\.lag_s: expected a value, found none\.\n  brakes\.lag_ms: no such setting",
        ),
        ("[aero]", "[air]", r"aero: expected a value, found none\.\n  air: no such setting"),
        (
            'drag = { value = 0.30, source = "public data" }',
            "drag = 0.30",
            r"aero\.drag: expected \{ value, source \}",
        ),
        (
            'drag = { value = 0.30, source = "public data" }',
            'drag = { value = 0.30, source = " " }',
            r"aero\.drag: expected a source in words",
        ),
        ("[road]", "[road", "car .*car.toml"),
    ],
)
def test_a_file_with_missing_unknown_or_unsourced_fields_is_refused(
    old: str, new: str, named: str, tmp_path: Path
) -> None:
    head, tail = TEXT.split("[brakes]")
    changed = f"{head}[brakes]{tail.replace(old, new, 1)}"
    with pytest.raises(ConfigError, match=named):
        load(changed, tmp_path)


def test_all_errors_of_a_car_file_are_reported_at_once(tmp_path: Path) -> None:
    text = with_value("mass_kg", "-1.0").replace("lag_s = { value = 0.06", "lag_s = { value = true")
    with pytest.raises(ConfigError) as refused:
        load(text, tmp_path)
    assert "body.mass_kg: expected more than 0.0, found -1.0" in str(refused.value)
    assert "brakes.lag_s: expected a number, found True" in str(refused.value)


def test_an_unknown_car_is_refused_with_the_list_of_shipped_cars() -> None:
    with pytest.raises(ConfigError, match=r"expected one of c_class_125kw_fwd, .*\.toml"):
        load_parameters("limousine")
    with pytest.raises(ConfigError, match="expected a car file in UTF-8 that can be read"):
        load_parameters("no/such/car.toml")


def test_cornering_stiffness_is_scaled_in_both_kinds_of_tyres() -> None:
    car, soft = default_car(), with_cornering_stiffness(default_car(), 0.8)
    assert soft.tyre.cornering_stiffness_npr == 0.8 * car.tyre.cornering_stiffness_npr
    assert soft.tyre_file.lky == 0.8 * car.tyre_file.lky
    with pytest.raises(ConfigError, match="cornering stiffness: expected a positive number"):
        with_cornering_stiffness(car, 0.0)


def test_road_friction_is_set_for_both_sides_or_for_each_side() -> None:
    assert with_road_friction(default_car(), 0.5).road[:2] == (0.5, 0.5)
    assert with_road_friction(default_car(), 0.5, 0.9).road[:2] == (0.5, 0.9)
    with pytest.raises(ConfigError, match=r"road\.friction_right: expected a positive"):
        with_road_friction(default_car(), 0.5, -0.9)
