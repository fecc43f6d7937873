"""The SI unit of a signal is read from its name."""

import pytest

from rt_controller.mapping.units import si_unit_of_name


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
