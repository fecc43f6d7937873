"""Units of variables follow from their names."""

import re

import pytest

from sim_bridge.fmu_export.fmu_units import NO_UNIT, FmuUnit, unit_of, words_of
from sim_bridge.fmu_export.variables import fmu_variables
from sim_bridge.plant.parameters import load_parameters
from sim_bridge.plant.shipped_cars import shipped_cars

_LIKE_A_UNIT = re.compile(r"(kg|k?n|m|s|rad|deg|m?pa|k?rpm|k?w|j|h|p|\d)+")
"""ends of names that belong to quantities with a unit"""


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("steer_rad", FmuUnit("rad", rad=1)),
        ("yaw_inertia_kgm2", FmuUnit("kg.m2", kg=1, m=2)),
        ("spring_front_npm", FmuUnit("N/m", kg=1, s=-2)),
        ("steer_radpn", FmuUnit("rad/N", kg=-1, m=-1, s=2, rad=1)),
        ("steer_radpnm", FmuUnit("rad/(N.m)", kg=-1, m=-2, s=2, rad=1)),
        ("curvature_per_m", FmuUnit("1/m", m=-1)),
        ("pedal_mpa_per_n", FmuUnit("MPa/N", m=-2, factor=1e6)),
        ("lateral_friction_per_load", NO_UNIT),
        ("ratios", NO_UNIT),
        ("drag", NO_UNIT),
        ("up_rpm_full", unit_of("engine_rpm")),
        ("fnomin", FmuUnit("N", kg=1, m=1, s=-2)),
        ("unloaded_radius", FmuUnit("m", m=1)),
        ("curvature_change_per_m2", FmuUnit("1/m2", m=-2)),
    ],
)
def test_the_end_of_a_name_is_its_unit(name: str, unit: FmuUnit) -> None:
    assert unit_of(name) == unit


def test_the_words_of_a_name_leave_its_unit_out() -> None:
    assert words_of("yaw_inertia_kgm2") == "yaw inertia"
    assert words_of("drag_nm_per_krpm") == "drag"
    assert words_of("up_rpm_full") == "up full"
    assert words_of("lateral_friction_per_load") == "lateral friction per load"


@pytest.mark.parametrize("car", shipped_cars())
def test_no_unit_of_a_car_is_overlooked(car: str) -> None:
    for variable in fmu_variables(load_parameters(car), {}):
        _, *words = variable.name.partition("[")[0].split("_")
        for word in words:
            if _LIKE_A_UNIT.fullmatch(word) and "per_load" not in variable.name:
                assert variable.unit != NO_UNIT, f"{variable.name}: add {word} to fmu_units.py"
