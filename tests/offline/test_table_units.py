"""The units in which people read what the arrays hold in SI."""

import numpy as np
import pytest

from offline.table_units import per_si, table_columns
from rt_controller.contract.schema import VEHICLE, Schema, Signal


def columns_of(*states):
    return table_columns(Schema(tuple(Signal(*state) for state in states), (), (), 0.1))


def test_the_car_is_read_in_the_units_of_the_papers_table():
    columns = table_columns(VEHICLE)
    assert [column.name for column in columns] == ["vx", "vy", "yaw_rate", "ds", "ey", "epsi"]
    assert [column.unit for column in columns] == ["km/h", "km/h", "deg/s", "m", "m", "deg"]
    assert [column.squared_unit for column in columns] == [
        "(km/h)^2", "(km/h)^2", "(deg/s)^2", "m^2", "m^2", "deg^2",
    ]  # fmt: skip
    degrees = float(np.degrees(1.0))
    assert per_si(columns).tolist() == [3.6, 3.6, degrees, 1.0, 1.0, degrees]


def test_keys_for_programs_end_in_the_unit():
    columns = table_columns(VEHICLE)
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
def test_states_of_other_schemas_keep_their_unit_unless_it_is_one_the_table_converts(
    state, name, unit, key
):
    (column,) = columns_of(state)
    assert (column.name, column.unit, column.key) == (name, unit, key)


def test_a_state_without_a_unit_has_none_when_squared():
    assert columns_of(("gear", "1"), ("charge", ""))[0].squared_unit == "1"
