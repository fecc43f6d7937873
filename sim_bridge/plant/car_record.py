"""`car_record`: the numbers of a car as one numpy record, which kernels read through one pointer.

As named tuples, all 430 numbers would be arguments of each kernel that takes a car: it would be
compiled three times slower and run a fifth slower. The fields have the same names and values.
"""

from typing import Any, cast

import numpy as np

from sim_bridge.plant.car_parts import RoadParameters
from sim_bridge.plant.parameters import Parameters


def car_record(parameters: Parameters) -> Parameters:
    """The same numbers as a copy that kernels take in place of `Parameters`.

    Later changes of one are not seen by the other, and equality is that of numpy.
    """
    dtype, values = _field(parameters)
    return cast(Parameters, np.array(values, dtype=dtype)[()])


def set_road(record: Parameters, road: RoadParameters) -> None:
    """Write another road into a record, which takes less time than a new record."""
    cast(Any, record)["road"] = road


def _field(value: Any) -> tuple[np.dtype[Any], Any]:
    """Data type and content of one field: a number, a table, or a named tuple of fields."""
    if not hasattr(value, "_fields"):
        return np.dtype((np.float64, np.shape(value))), value
    dtypes, values = zip(*map(_field, value), strict=True)
    return np.dtype(list(zip(value._fields, dtypes, strict=True))), values
