"""Units as loggers and FMUs write them are converted to SI, or refused with similar spellings."""

import pytest

from rt_controller.contract.errors import ConfigError
from rt_controller.mapping.units import (
    find_unit,
    near_units,
    require_unit,
    si_unit_of_name,
    unit_of_exponents,
    unit_of_name,
)
from sim_bridge.plant.protocol import RoadAt


@pytest.mark.parametrize(
    ("text", "number", "si", "value"),
    [
        ("km/h", 36.0, "m/s", 10.0),
        ("kn", 3600.0, "m/s", 1852.0),
        ("deg", 180.0, "rad", 3.14159265),
        ("g", 1.0, "m/s^2", 9.80665),
        ("bar", 2.0, "Pa", 2e5),
        ("%", 40.0, "1", 0.4),
        ("rpm", 60.0, "rad/s", 6.28318531),
        ("degC", 20.0, "K", 293.15),
    ],
)
def test_a_number_in_an_allowed_unit_is_converted_to_si(text, number, si, value):
    unit = find_unit(text)
    assert unit.si == si
    assert unit.factor * number + unit.offset == pytest.approx(value, rel=1e-8)


@pytest.mark.parametrize(
    ("spelling", "plain"),
    [
        ("KM/H", "km/h"),
        ("kph", "km/h"),
        ("[m/s²]", "m/s^2"),
        ("m/s**2", "m/s^2"),
        ("°/s", "deg/s"),
        (" Degrees ", "deg"),
        ("Nm", "N m"),
        ("rev/min", "rpm"),
        ("", "1"),
    ],
)
def test_other_spellings_are_accepted(spelling, plain):
    assert find_unit(spelling) == find_unit(plain) is not None


def test_every_dimension_of_a_road_is_read_from_its_name():
    units = {name: unit_of_name(name) for name in RoadAt._fields}
    assert units == {
        "curvature_per_m": "1/m",
        "curvature_change_per_m2": "1/m^2",
        "friction_left": None,
        "friction_right": None,
        "bank_rad": "rad",
        "grade_rad": "rad",
        "wind_forward_mps": "m/s",
        "wind_left_mps": "m/s",
    }
    assert find_unit("1/m2") == find_unit("1/m^2") == unit_of_exponents(0, -2, 0, 0, 1.0)
    assert find_unit("1/m^2").quantity == "change of curvature"
    assert unit_of_exponents(0, -1, 0, 0, 1e-3) == find_unit("1/km")
    assert unit_of_exponents(1, 1, -2, 0, 1e3).quantity == "force"
    assert unit_of_exponents(0, 0, 0, 3, 1.0) is None


def test_an_unknown_unit_is_refused_with_similar_spellings():
    assert find_unit("furlong") is None
    assert find_unit("mPa") is None  # case changes the factor
    assert find_unit("MPa").factor == 1e6
    assert near_units("").startswith("the allowed units are 1, %, m")
    assert near_units("", "m/s") == "the allowed units are m/s, km/h, mph, kn"
    with pytest.raises(ConfigError, match=r"car\.toml: expected .* did you mean km/h .*scale"):
        require_unit("km/hh", "car.toml")


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("vx_mps", "m/s"),
        ("yaw_rate_radps", "rad/s"),
        ("steer_rad", "rad"),
        ("curvature_per_m", "1/m"),
        ("ax_mps2", "m/s^2"),
        ("brake_n", "N"),
        ("throttle", None),
    ],
)
def test_the_suffix_of_a_name_is_its_si_unit(name, unit):
    assert si_unit_of_name(name) == unit


@pytest.mark.parametrize("ending", ["kmh", "rpm", "mpa"])
def test_a_name_with_a_suffix_outside_si_is_refused(ending):
    with pytest.raises(ValueError, match=f"SI unit, found '{ending}'"):
        si_unit_of_name(f"signal_{ending}")
