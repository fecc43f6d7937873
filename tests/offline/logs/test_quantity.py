"""The SI unit of a signal is read from its name."""

import pytest

from offline.logs.quantity import unit_of_name


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
    assert unit_of_name(name) == unit


def test_a_name_with_a_suffix_outside_si_is_refused():
    with pytest.raises(ValueError, match="SI unit, found 'kmh'"):
        unit_of_name("vx_kmh")
