"""The units that people read: km/h and degrees, as in the paper's Table I, instead of SI."""

import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.schema import Schema, Signal

Array = NDArray[np.float64]

_READ_AS = {
    "m/s": ("km/h", 3.6),
    "rad/s": ("deg/s", float(np.degrees(1.0))),
    "rad": ("deg", float(np.degrees(1.0))),
}
"""by SI unit: unit of the table, and how many of it make one; other units stay as they are"""


class Column(NamedTuple):
    """A state as the tables show it."""

    name: str
    """without its unit"""
    unit: str
    per_si: float
    """so many of `unit` make one of the state's own"""

    @property
    def key(self) -> str:
        """Name with the unit, for JSON: "vx_kmh"."""
        return "_".join(filter(None, (self.name, _word(self.unit))))

    @property
    def squared_key(self) -> str:
        return f"{self.key}_squared"

    @property
    def squared_unit(self) -> str:
        """As the paper prints it: "(km/h)^2", "m^2"."""
        if self.unit in ("", "1"):
            return "1"
        return f"{self.unit}^2" if self.unit.isalpha() else f"({self.unit})^2"


def table_columns(schema: Schema) -> tuple[Column, ...]:
    """The states of a schema, in their order."""
    return tuple(map(_column, schema.states))


def per_si(columns: tuple[Column, ...]) -> Array:
    """(n,) factors from the states' own units to those of the table."""
    return np.array([column.per_si for column in columns])


def _column(state: Signal) -> Column:
    unit, factor = _READ_AS.get(state.unit, (state.unit, 1.0))
    return Column(state.name.removesuffix(f"_{_word(state.unit)}"), unit, factor)


def _word(unit: str) -> str:
    """A unit as the end of a name: "m/s" is mps, "km/h" is kmh, "1/m" is per_m, "1" is nothing."""
    if unit in ("", "1"):
        return ""
    if unit == "km/h":
        return "kmh"
    if unit.startswith("1/"):
        return "per_" + _word(unit.removeprefix("1/"))
    return re.sub(r"[^a-z0-9]", "", unit.lower().replace("/", "p"))
