"""`car_record`: the numbers of a car as one array, in the layout of `Parameters` in C."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from rt_controller.contract.arrays import Array
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.parts import RoadParameters

_PARTS = [*Parameters.__annotations__.values()]
_ROAD = sum(len(part._fields) for part in _PARTS[: Parameters._fields.index("road")])
"""place of its first number"""


def car_record(parameters: Parameters) -> Array:
    """(434,) all numbers of the car and its road, in the order of the named tuples."""
    return np.array([*_numbers(parameters)])


def set_road(record: Array, road: RoadParameters) -> None:
    """Write another road into a record, which takes less time than a new record."""
    record[_ROAD : _ROAD + len(road)] = road


def _numbers(value: Any) -> Iterator[float]:
    if isinstance(value, tuple):
        for part in value:
            yield from _numbers(part)
    else:
        yield value
