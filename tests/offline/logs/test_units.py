"""What engineers write becomes SI, or is refused with what they may have meant."""

import pytest

from offline.logs.units import near_units, parse_unit, unit_of_name


@pytest.mark.parametrize(
    ("text", "number", "si", "value"),
    [
        ("km/h", 36.0, "m/s", 10.0),
        ("deg", 180.0, "rad", 3.14159265),
        ("deg/s", 90.0, "rad/s", 1.57079633),
        ("g", 1.0, "m/s^2", 9.80665),
        ("bar", 2.0, "Pa", 2e5),
        ("%", 40.0, "1", 0.4),
        ("rpm", 60.0, "rad/s", 6.28318531),
        ("degC", 20.0, "K", 293.15),
        ("ms", 25.0, "s", 0.025),
        ("kN", 1.5, "N", 1500.0),
    ],
)
def test_a_number_in_a_known_unit_becomes_si(text, number, si, value):
    unit = parse_unit(text)
    assert unit.si == si
    assert unit.factor * number + unit.offset == pytest.approx(value)


@pytest.mark.parametrize(
    ("spelling", "plain"),
    [
        ("KM/H", "km/h"),
        ("kph", "km/h"),
        ("[m/s²]", "m/s^2"),
        ("m/s2", "m/s^2"),
        ("m/s**2", "m/s^2"),
        ("°/s", "deg/s"),
        (" Degrees ", "deg"),
        ("Nm", "N m"),
        ("", "1"),
        ("-", "1"),
    ],
)
def test_spellings_of_loggers_are_understood(spelling, plain):
    assert parse_unit(spelling) == parse_unit(plain) is not None


def test_the_size_of_a_letter_is_not_ignored_where_it_is_a_factor():
    assert parse_unit("MPa").factor == 1e6
    assert parse_unit("mPa") is None


def test_an_unknown_unit_is_none_and_near_ones_are_named():
    assert parse_unit("furlong") is None
    assert "km/h" in near_units("km/hh")
    assert near_units("").startswith("known are 1, %, m")


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
def test_a_name_says_its_unit(name, unit):
    assert unit_of_name(name) == unit


def test_a_name_in_a_foreign_unit_is_refused():
    with pytest.raises(ValueError, match="SI unit, found 'kmh'"):
        unit_of_name("vx_kmh")
