"""Units of numbers from outside (logs, a car's own messages, FMUs), and their conversion to SI.

Only the units listed here are accepted, in the meaning that they have in vehicle data: "g" is the
acceleration of gravity.

    unit = require_unit("km/h", "car.toml: inputs.speed")     # find_unit: None if unknown
    value_si = unit.factor * value + unit.offset
    unit.si, unit.quantity                                     # "m/s", "speed"
"""

import re
from math import pi
from typing import NamedTuple

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.names import near_names

_DEG, _INCH, _LBF = pi / 180.0, 0.0254, 4.4482216152605
_FACTORS: dict[str, dict[str, float]] = {
    "1": {"1": 1, "%": 0.01},
    "m": {"m": 1, "km": 1e3, "cm": 0.01, "mm": 1e-3, "ft": 12 * _INCH},
    "1/m": {"1/m": 1, "1/km": 1e-3},
    "1/m^2": {"1/m^2": 1},
    "m/s": {"m/s": 1, "km/h": 1 / 3.6, "mph": 0.44704, "kn": 1852 / 3600},
    "m/s^2": {"m/s^2": 1, "g": 9.80665},
    "rad": {"rad": 1, "mrad": 1e-3, "deg": _DEG},
    "rad/s": {"rad/s": 1, "deg/s": _DEG, "rpm": pi / 30.0},
    "rad/s^2": {"rad/s^2": 1, "deg/s^2": _DEG},
    "N": {"N": 1, "kN": 1e3, "daN": 10, "lbf": _LBF},
    "N m": {"N m": 1, "kN m": 1e3},
    "Pa": {"Pa": 1, "kPa": 1e3, "MPa": 1e6, "bar": 1e5, "mbar": 100, "psi": _LBF / _INCH**2},
    "W": {"W": 1, "kW": 1e3},
    "V": {"V": 1},
    "A": {"A": 1},
    "kg": {"kg": 1},
    "K": {"K": 1, "degC": 1},
    "s": {"s": 1, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60, "h": 3600},
}
"""by SI unit: the units that are converted to it"""
_QUANTITIES: list[str] = re.findall(
    "[a-z ]+",
    "ratio,length,curvature,change of curvature,speed,acceleration,angle,angular speed,"
    "angular acceleration,force,torque,pressure,power,voltage,current,mass,temperature,time",
)
"""of each row above"""
_SPELLINGS = {
    text: name
    for name, texts in {
        "1": "|-",
        "%": "percent|pct",
        "1/m": "per_m",
        "1/m^2": "per_m2",
        "m/s": "mps|meter per second",
        "km/h": "kmh|kph|km/hr|kmph",
        "mph": "mi/h",
        "kn": "knots",
        "m/s^2": "mps2|m/ss",
        "deg": "degree|degrees|°|º",
        "deg/s": "°/s|º/s|deg/sec|degree/s|degps|dps",
        "rad": "radian|radians",
        "rad/s": "rad/sec|radps",
        "rad/s^2": "radps2",
        "rpm": "1/min|r/min|rev/min",
        "N": "newton",
        "N m": "nm|n*m|n.m|n·m",
        "s": "sec|seconds",
        "ms": "msec",
        "us": "µs|μs",
        "degC": "°c|celsius",
    }.items()
    for text in texts.split("|")
}
_SI_OF_EXPONENTS = {
    (0, 0, 0, 0): "1",
    (0, 1, 0, 0): "m",
    (0, -1, 0, 0): "1/m",
    (0, -2, 0, 0): "1/m^2",
    (0, 1, -1, 0): "m/s",
    (0, 1, -2, 0): "m/s^2",
    (0, 0, 0, 1): "rad",
    (0, 0, -1, 1): "rad/s",
    (0, 0, -1, 0): "rad/s",
    (1, 1, -2, 0): "N",
    (1, 2, -2, 0): "N m",
    (1, -1, -2, 0): "Pa",
}
"""by the exponents of kg, m, s and rad"""
_OFFSETS = {"degC": 273.15}

_NAME_ENDINGS = (
    *("per_m", "per_m2", "m", "mps", "mps2", "rad", "radps", "radps2"),
    *("n", "nm", "pa", "w", "kg", "k", "s"),
    *("kmh", "kph", "mph", "deg", "degps", "dps", "g", "bar", "rpm", "percent", "pct", "ms"),
)
"""of signal names; those of the first two rows are in SI"""


class Unit(NamedTuple):
    """A unit of measurement: value in SI = factor * value + offset."""

    si: str
    """the SI unit, as `rt_controller.contract.signals` spells it"""
    factor: float
    offset: float = 0.0

    @property
    def quantity(self) -> str:
        """What the unit measures, for messages: "speed", "force"."""
        return _QUANTITIES[list(_FACTORS).index(self.si)]


_ALLOWED = {
    name: Unit(si, float(factor), _OFFSETS.get(name, 0.0))
    for si, factors in _FACTORS.items()
    for name, factor in factors.items()
}


def find_unit(text: str) -> Unit | None:
    """The allowed unit with this spelling; None if it is not allowed."""
    name = _find_name(text)
    return None if name is None else _ALLOWED[name]


def require_unit(text: str, where: str) -> Unit:
    """The allowed unit with this spelling.

    Raises:
        ConfigError: the unit is not allowed; the message starts with `where`.
    """
    unit = find_unit(text)
    if unit is None:
        raise ConfigError(
            f"{where}: expected an allowed unit, found {text!r}; {near_units(text)}. Name one of "
            f"them and put the remaining factor into scale."
        )
    return unit


def unit_of_name(name: str) -> str | None:
    """The allowed unit that the name of a signal ends in: "m/s" of vx_mps; None: in none."""
    if name.endswith("_mpa"):  # as a unit this spelling is ambiguous
        return "MPa"
    found = [ending for ending in _NAME_ENDINGS if name.endswith(f"_{ending}")]
    return _find_name(found[0]) if found else None


def si_unit_of_name(name: str) -> str | None:
    """The SI unit that a name ends in; None if in none; `ValueError` if in one outside SI."""
    unit = unit_of_name(name)
    if unit is not None and unit not in _FACTORS:
        raise ValueError(
            f"{name}: expected a name that ends in an SI unit, found {name.rpartition('_')[2]!r}. "
            f"Data sets are in SI: use such a name (for example vx_mps, yaw_rate_radps, "
            f"steer_rad), and give the log's unit in `unit`"
        )
    return unit


def unit_of_exponents(kg: int, m: int, s: int, rad: int, to_si: float) -> Unit | None:
    """The unit with these exponents of SI base units, as in an FMU; None if it is not allowed."""
    si = _SI_OF_EXPONENTS.get((kg, m, s, rad))
    return None if si is None else Unit(si, to_si)


def near_units(text: str, si: str | None = None) -> str:
    """Words for a message: allowed units with a similar spelling, and all allowed units.

    With `si` only those that are converted to it are listed.
    """
    spellings = [spelling for spelling in (*_ALLOWED, *_SPELLINGS) if spelling]
    near = near_names(text, spellings, most=3)
    allowed = [name for name, unit in _ALLOWED.items() if si is None or unit.si == si]
    listed = f"the allowed units are {', '.join(allowed)}"
    return f"did you mean {' or '.join(near)}? T{listed[1:]}" if near else listed


def _find_name(text: str) -> str | None:
    plain = text.strip().removeprefix("[").removesuffix("]").strip()
    for power in ("²", "**2"):
        plain = plain.replace(power, "^2")
    if plain.endswith(("/s2", "/m2")):
        plain = plain[:-1] + "^2"
    if plain in _ALLOWED:
        return plain
    lowered = plain.lower()
    if lowered in _SPELLINGS:
        return _SPELLINGS[lowered]
    # "KM/H" is accepted, "mpa" for MPa is not: the case of the letter is a factor of 10^9 there.
    fits = [name for name in _ALLOWED if name.lower() == lowered]
    return fits[0] if len(fits) == 1 and lowered not in {"mpa", "mw"} else None
