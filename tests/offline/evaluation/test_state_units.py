"""Units of the states in tables."""

import numpy as np
import pytest

from offline.evaluation.metrics import state_units
from rt_controller.contract.schema import VEHICLE, Schema, Signal


def units_of(*states):
    return state_units(Schema(tuple(Signal(*state) for state in states), (), (), 0.1))


def test_states_of_the_car_have_the_units_of_the_papers_table():
    columns = state_units(VEHICLE)
    assert [column.name for column in columns] == ["vx", "vy", "yaw_rate", "ds", "ey", "epsi"]
    assert [column.unit for column in columns] == ["km/h", "km/h", "deg/s", "m", "m", "deg"]
    assert [column.squared_unit for column in columns] == [
        "(km/h)^2", "(km/h)^2", "(deg/s)^2", "m^2", "m^2", "deg^2",
    ]  # fmt: skip
    degrees = float(np.degrees(1.0))
    assert [column.per_si for column in columns] == [3.6, 3.6, degrees, 1.0, 1.0, degrees]


def test_json_keys_end_in_the_unit():
    columns = state_units(VEHICLE)
    assert [column.key for column in columns][:4] == ["vx_kmh", "vy_kmh", "yaw_rate_degps", "ds_m"]
    assert columns[2].squared_key == "yaw_rate_degps_squared"


@pytest.mark.parametrize(
    ("state", "name", "unit", "key"),
    [
        (("temperature_k", "K"), "temperature", "K", "temperature_k"),
        (("ax_mps2", "m/s^2"), "ax", "m/s^2", "ax_mps2"),
        (("curvature_per_m", "1/m"), "curvature", "1/m", "curvature_per_m"),
        (("gear", "1"), "gear", "1", "gear"),
        (("charge", ""), "charge", "", "charge"),
        (("speed", "m/s"), "speed", "km/h", "speed_kmh"),
    ],
)
def test_other_states_keep_their_unit_unless_it_is_m_per_s_or_rad(state, name, unit, key):
    (column,) = units_of(state)
    assert (column.name, column.unit, column.key) == (name, unit, key)


def test_a_state_without_a_unit_has_none_when_squared():
    assert units_of(("gear", "1"), ("charge", ""))[0].squared_unit == "1"
