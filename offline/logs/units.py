"""Units that logs are written in, and the way from each to SI.

One spelling of each SI unit is the project's own (`rt_controller.contract.signals`); the others are
what loggers, databases and people write.
"""

from difflib import get_close_matches
from math import pi
from typing import NamedTuple


class Unit(NamedTuple):
    """SI = factor * number + offset."""

    si: str
    factor: float
    offset: float = 0.0


_GRAVITY_MPS2 = 9.80665
_DEGREE = pi / 180.0

_UNITS = {
    "1": Unit("1", 1.0),
    "%": Unit("1", 0.01),
    "m": Unit("m", 1.0),
    "km": Unit("m", 1e3),
    "cm": Unit("m", 1e-2),
    "mm": Unit("m", 1e-3),
    "ft": Unit("m", 0.3048),
    "1/m": Unit("1/m", 1.0),
    "1/km": Unit("1/m", 1e-3),
    "m/s": Unit("m/s", 1.0),
    "km/h": Unit("m/s", 1.0 / 3.6),
    "mph": Unit("m/s", 0.44704),
    "kn": Unit("m/s", 1852.0 / 3600.0),
    "m/s^2": Unit("m/s^2", 1.0),
    "g": Unit("m/s^2", _GRAVITY_MPS2),
    "rad": Unit("rad", 1.0),
    "mrad": Unit("rad", 1e-3),
    "deg": Unit("rad", _DEGREE),
    "rad/s": Unit("rad/s", 1.0),
    "deg/s": Unit("rad/s", _DEGREE),
    "rpm": Unit("rad/s", pi / 30.0),
    "rad/s^2": Unit("rad/s^2", 1.0),
    "deg/s^2": Unit("rad/s^2", _DEGREE),
    "N": Unit("N", 1.0),
    "kN": Unit("N", 1e3),
    "daN": Unit("N", 10.0),
    "lbf": Unit("N", 4.4482216152605),
    "N m": Unit("N m", 1.0),
    "kN m": Unit("N m", 1e3),
    "Pa": Unit("Pa", 1.0),
    "kPa": Unit("Pa", 1e3),
    "MPa": Unit("Pa", 1e6),
    "bar": Unit("Pa", 1e5),
    "mbar": Unit("Pa", 1e2),
    "psi": Unit("Pa", 6894.757293168),
    "W": Unit("W", 1.0),
    "kW": Unit("W", 1e3),
    "V": Unit("V", 1.0),
    "A": Unit("A", 1.0),
    "kg": Unit("kg", 1.0),
    "K": Unit("K", 1.0),
    "degC": Unit("K", 1.0, 273.15),
    "s": Unit("s", 1.0),
    "ms": Unit("s", 1e-3),
    "us": Unit("s", 1e-6),
    "ns": Unit("s", 1e-9),
    "min": Unit("s", 60.0),
    "h": Unit("s", 3600.0),
}

_SPELLINGS = {
    "": "1",
    "-": "1",
    "percent": "%",
    "pct": "%",
    "mps": "m/s",
    "meter per second": "m/s",
    "kmh": "km/h",
    "kph": "km/h",
    "km/hr": "km/h",
    "kmph": "km/h",
    "mi/h": "mph",
    "knots": "kn",
    "mps2": "m/s^2",
    "m/ss": "m/s^2",
    "degree": "deg",
    "degrees": "deg",
    "°": "deg",
    "º": "deg",
    "°/s": "deg/s",
    "º/s": "deg/s",
    "deg/sec": "deg/s",
    "degree/s": "deg/s",
    "dps": "deg/s",
    "radian": "rad",
    "radians": "rad",
    "rad/sec": "rad/s",
    "radps": "rad/s",
    "1/min": "rpm",
    "r/min": "rpm",
    "newton": "N",
    "nm": "N m",
    "n*m": "N m",
    "n.m": "N m",
    "n·m": "N m",
    "sec": "s",
    "seconds": "s",
    "msec": "ms",
    "µs": "us",
    "μs": "us",
    "°c": "degC",
    "celsius": "degC",
}

_SUFFIXES = {
    "per_m": "1/m",
    "mps2": "m/s^2",
    "radps2": "rad/s^2",
    "mps": "m/s",
    "radps": "rad/s",
    "rad": "rad",
    "nm": "N m",
    "pa": "Pa",
    "kg": "kg",
    "m": "m",
    "n": "N",
    "s": "s",
    "w": "W",
    "k": "K",
}
_FOREIGN_SUFFIXES = ("kmh", "kph", "mph", "deg", "degps", "dps", "g", "bar", "percent", "pct", "ms")


def parse_unit(text: str) -> Unit | None:
    """The unit that is written there, or None if it is none of those known here."""
    plain = text.strip().removeprefix("[").removesuffix("]").strip()
    for power in ("²", "**2"):
        plain = plain.replace(power, "^2")
    if plain.endswith("/s2"):
        plain = plain[:-1] + "^2"
    if plain in _UNITS:
        return _UNITS[plain]
    lowered = plain.lower()
    if lowered in _SPELLINGS:
        return _UNITS[_SPELLINGS[lowered]]
    # "KM/H", but never "mpa" for MPa: a letter's size is a factor of a billion there.
    fits = [unit for name, unit in _UNITS.items() if name.lower() == lowered]
    return fits[0] if len(fits) == 1 and lowered not in {"mpa", "mw"} else None


def near_units(text: str) -> str:
    """Known units that look like it, or all of them, to be named in a message."""
    spellings = [spelling for spelling in (*_UNITS, *_SPELLINGS) if spelling]
    near = get_close_matches(text, spellings, n=3, cutoff=0.5)
    known = ", ".join(_UNITS)
    return f"did you mean {' or '.join(near)}? Known are {known}" if near else f"known are {known}"


def unit_of_name(name: str) -> str | None:
    """The SI unit that a signal's name ends in; None where it ends in none.

    Raises:
        ValueError: it ends in a unit that is not of SI.
    """
    words = name.split("_")
    if words[-1] in _FOREIGN_SUFFIXES and len(words) > 1:
        raise ValueError(
            f"{name}: expected a name that ends in an SI unit, found {words[-1]!r}. Data sets are "
            f"in SI: name it so (for example vx_mps, yaw_rate_radps, steer_rad), and give the "
            f"log's unit in `unit`"
        )
    for suffix, unit in _SUFFIXES.items():
        if name.endswith("_" + suffix):
            return unit
    return None
