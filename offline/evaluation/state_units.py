"""Units of the states in tables: km/h and degrees, as in the paper's Table I, instead of SI."""

import re
from typing import NamedTuple

import numpy as np

from rt_controller.contract.schema import Schema

_TABLE_UNITS = {
    "m/s": ("km/h", 3.6),
    "rad/s": ("deg/s", float(np.degrees(1.0))),
    "rad": ("deg", float(np.degrees(1.0))),
}
"""by SI unit: unit in tables, and the factor to it; other units are not converted"""


class StateUnit(NamedTuple):
    """Name and unit of a state in tables."""

    name: str
    """without the unit"""
    unit: str
    per_si: float
    """value in `unit` = per_si * value in the state's own unit"""

    @property
    def key(self) -> str:
        """Name with unit for JSON: "vx_kmh"."""
        return "_".join(filter(None, (self.name, _suffix(self.unit))))

    @property
    def squared_key(self) -> str:
        """Key of a squared error: "vx_kmh_squared"."""
        return f"{self.key}_squared"

    @property
    def squared_unit(self) -> str:
        """Unit of a squared error as the paper prints it: "(km/h)^2", "m^2"."""
        if self.unit in ("", "1"):
            return "1"
        return f"{self.unit}^2" if self.unit.isalpha() else f"({self.unit})^2"


def state_units(schema: Schema) -> tuple[StateUnit, ...]:
    """The states of a schema, in their order."""
    units = []
    for state in schema.states:
        unit, factor = _TABLE_UNITS.get(state.unit, (state.unit, 1.0))
        name = state.name.removesuffix(f"_{_suffix(state.unit)}")
        units.append(StateUnit(name, unit, factor))
    return tuple(units)


def _suffix(unit: str) -> str:
    """A unit as the end of a name: "mps" of "m/s", "kmh" of "km/h", "per_m" of "1/m", "" of "1"."""
    if unit in ("", "1"):
        return ""
    if unit == "km/h":
        return "kmh"
    if unit.startswith("1/"):
        return "per_" + _suffix(unit.removeprefix("1/"))
    return re.sub(r"[^a-z0-9]", "", unit.lower().replace("/", "p"))
