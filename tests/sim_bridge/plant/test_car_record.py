"""A car as a numpy record has the numbers of its named tuples."""

from typing import Any

import numpy as np
import pytest

from sim_bridge.plant.car_record import car_record
from sim_bridge.plant.parameters import load_parameters
from sim_bridge.plant.shipped_cars import shipped_cars


def assert_same_numbers(record: Any, value: Any) -> None:
    if not hasattr(value, "_fields"):
        np.testing.assert_array_equal(record, value)
        return
    assert record.dtype.names == value._fields
    for name in value._fields:
        assert_same_numbers(record[name], getattr(value, name))


@pytest.mark.parametrize("name", shipped_cars())
def test_every_number_is_under_its_name(name: str) -> None:
    car = load_parameters(name)
    assert_same_numbers(car_record(car), car)
