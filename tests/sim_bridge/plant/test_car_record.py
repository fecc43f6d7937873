"""A car as an array has the numbers of its named tuples."""

import numpy as np
import pytest

from sim_bridge.plant.car_record import car_record, set_road
from sim_bridge.plant.parameters import load_parameters, with_road
from sim_bridge.plant.parts import RoadParameters
from sim_bridge.plant.shipped_cars import shipped_cars

ROAD = RoadParameters(0.3, 0.4, 0.05, -0.06, 7.0, -8.0)


@pytest.mark.parametrize("name", shipped_cars())
def test_another_road_is_written_to_its_place(name: str) -> None:
    car = load_parameters(name)
    record = car_record(car)
    set_road(record, ROAD)
    np.testing.assert_array_equal(record, car_record(with_road(car, ROAD)))
