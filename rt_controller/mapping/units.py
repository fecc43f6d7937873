"""Units of numbers from outside (logs, a car's own messages, FMUs), and their conversion to SI.

pint converts. Only the units listed here are accepted, in the meaning that they have in vehicle
data: "g" is the acceleration of gravity, which pint alone would read as gram. pint is imported on
the first conversion.

    unit = require_unit("km/h", "car.toml: inputs.speed")     # find_unit: None if unknown
    value_si = unit.factor * value + unit.offset
    unit.si, unit.quantity                                     # "m/s", "speed"
"""

from difflib import get_close_matches
from functools import cache
from importlib.util import find_spec
from typing import Any, NamedTuple

from rt_controller.contract.errors import ConfigError, MissingExtraError, install_command

_ALLOWED = {
    "1": ("ratio", ("1", "%")),
    "m": ("length", ("m", "km", "cm", "mm", "ft")),
    "1/m": ("curvature", ("1/m", "1/km")),
    "1/m^2": ("change of curvature", ("1/m^2",)),
    "m/s": ("speed", ("m/s", "km/h", "mph", "kn")),
    "m/s^2": ("acceleration", ("m/s^2", "g")),
    "rad": ("angle", ("rad", "mrad", "deg")),
    "rad/s": ("angular speed", ("rad/s", "deg/s", "rpm")),
    "rad/s^2": ("angular acceleration", ("rad/s^2", "deg/s^2")),
    "N": ("force", ("N", "kN", "daN", "lbf")),
    "N m": ("torque", ("N m", "kN m")),
    "Pa": ("pressure", ("Pa", "kPa", "MPa", "bar", "mbar", "psi")),
    "W": ("power", ("W", "kW")),
    "V": ("voltage", ("V",)),
    "A": ("current", ("A",)),
    "kg": ("mass", ("kg",)),
    "K": ("temperature", ("K", "degC")),
    "s": ("time", ("s", "ms", "us", "ns", "min", "h")),
}
"""by SI unit: its quantity, and the units that are converted to it"""
_SI = {name: si for si, (_, names) in _ALLOWED.items() for name in names}
_PINT_NAMES = {"1": "dimensionless", "%": "percent", "g": "standard_gravity", "kn": "knot"}

_SPELLINGS = {
    "1": ("", "-"),
    "%": ("percent", "pct"),
    "1/m": ("per_m",),
    "1/m^2": ("per_m2",),
    "m/s": ("mps", "meter per second"),
    "km/h": ("kmh", "kph", "km/hr", "kmph"),
    "mph": ("mi/h",),
    "kn": ("knots",),
    "m/s^2": ("mps2", "m/ss"),
    "deg": ("degree", "degrees", "°", "º"),
    "deg/s": ("°/s", "º/s", "deg/sec", "degree/s", "degps", "dps"),
    "rad": ("radian", "radians"),
    "rad/s": ("rad/sec", "radps"),
    "rad/s^2": ("radps2",),
    "rpm": ("1/min", "r/min", "rev/min"),
    "N": ("newton",),
    "N m": ("nm", "n*m", "n.m", "n·m"),
    "s": ("sec", "seconds"),
    "ms": ("msec",),
    "us": ("µs", "μs"),
    "degC": ("°c", "celsius"),
}
_NAME_OF_SPELLING = {text: name for name, texts in _SPELLINGS.items() for text in texts}

_NAME_ENDINGS = (
    *("per_m", "per_m2", "m", "mps", "mps2", "rad", "radps", "radps2"),
    *("n", "nm", "pa", "w", "kg", "k", "s"),
    *("kmh", "kph", "mph", "deg", "degps", "dps", "g", "bar", "rpm", "percent", "pct", "ms"),
)
"""of signal names; those of the first two rows are in SI"""

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


class Unit(NamedTuple):
    """A unit of measurement: value in SI = factor * value + offset."""

    si: str
    """the SI unit, as `rt_controller.contract.signals` spells it"""
    factor: float
    offset: float = 0.0

    @property
    def quantity(self) -> str:
        """What the unit measures, for messages: "speed", "force"."""
        return _ALLOWED[self.si][0]


def find_unit(text: str) -> Unit | None:
    """The allowed unit with this spelling; None if it is not allowed.

    Raises:
        MissingExtraError: pint is not installed.
    """
    name = _find_name(text)
    return None if name is None else _to_si(name)


def require_unit(text: str, where: str) -> Unit:
    """The allowed unit with this spelling.

    Raises:
        ConfigError: the unit is not allowed; the message starts with `where`.
        MissingExtraError: pint is not installed.
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


def is_si(name: str) -> bool:
    """True for an allowed unit that is an SI unit."""
    return name in _ALLOWED


def unit_of_exponents(kg: int, m: int, s: int, rad: int, to_si: float) -> Unit | None:
    """The unit with these exponents of SI base units, as in an FMU; None if it is not allowed."""
    si = _SI_OF_EXPONENTS.get((kg, m, s, rad))
    return None if si is None else Unit(si, to_si)


def near_units(text: str) -> str:
    """Words for a message: allowed units with a similar spelling, and all allowed units."""
    spellings = [spelling for spelling in (*_SI, *_NAME_OF_SPELLING) if spelling]
    near = get_close_matches(text, spellings, n=3, cutoff=0.5)
    listed = f"the allowed units are {', '.join(_SI)}"
    return f"did you mean {' or '.join(near)}? T{listed[1:]}" if near else listed


def _find_name(text: str) -> str | None:
    plain = text.strip().removeprefix("[").removesuffix("]").strip()
    for power in ("²", "**2"):
        plain = plain.replace(power, "^2")
    if plain.endswith(("/s2", "/m2")):
        plain = plain[:-1] + "^2"
    if plain in _SI:
        return plain
    lowered = plain.lower()
    if lowered in _NAME_OF_SPELLING:
        return _NAME_OF_SPELLING[lowered]
    # "KM/H" is accepted, "mpa" for MPa is not: the case of the letter is a factor of 10^9 there.
    fits = [name for name in _SI if name.lower() == lowered]
    return fits[0] if len(fits) == 1 and lowered not in {"mpa", "mw"} else None


@cache
def _to_si(name: str) -> Unit:
    registry, si = _registry(), _SI[name]
    source, target = _PINT_NAMES.get(name, name), _PINT_NAMES.get(si, si)
    offset = float(registry.Quantity(0.0, source).to(target).magnitude)
    one = float(registry.Quantity(1.0, source).to(target).magnitude)
    return Unit(si, one - offset, offset)


@cache
def _registry() -> Any:
    if find_spec("pint") is None:
        raise MissingExtraError(
            f"units need the package pint, found it not installed. Run: {install_command('logs')} "
            f"for recorded logs, {install_command('signals')} for a car's own messages, "
            f"{install_command('fmu')} for FMUs"
        )
    import pint

    return pint.UnitRegistry()
